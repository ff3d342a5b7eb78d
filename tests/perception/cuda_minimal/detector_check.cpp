/// @file
/// Compares the detectors' networks on CUDA with those on the CPU, and times them. A test
/// program of its own, because the machine that it runs on has no test framework. Exit code 1
/// if a case fails.
///
///     detector_check [cpu|quick]      cpu: what needs no GPU (a test of the normal build);
///                                     quick: no times but those of the shared stream

#include <torch/torch.h>

#include <cstdio>
#include <exception>
#include <string>

#include "checks.h"
#include "perception/internal/network/torch_device.h"

namespace segsim::perception::checks {
namespace {

int run_all(ComputeDevice compute, bool with_times) {
  using yolov13::Scale;
  const torch::Device device = torch_device(compute, "check");
  const bool cuda = compute == ComputeDevice::kCuda;
  at::set_num_threads(cuda ? 8 : 1);
  const DetectorWeights small = lively_weights(DetectorWeights::kArchitecture, 12, 256);
  const DetectorWeights n128 = lively_yolo(Scale::kN, 128);
  check_forward("small", small, 3, device);
  check_forward("yolov13n", n128, 2, device);
  if (cuda) {
    check_forward("yolov13n 640", lively_yolo(Scale::kN, 640), 1, device);
    check_forward("yolov13s 320", lively_yolo(Scale::kS, 320), 1, device);
    check_forward("yolov13l 128", lively_yolo(Scale::kL, 128), 1, device);
    check_forward("yolov13x 128", lively_yolo(Scale::kX, 128), 1, device);
    check_loss("small", small, device);
    check_loss("yolov13n", n128, device);
  }
  check_decoding(small, device);
  check_decoding(n128, device);
  const DetectorWeights center = lively_weights(DetectorWeights::kCenterNet, 12, 128);
  check_heat_maps(center, device);
  check_steps("small", small, compute);
  check_steps("yolov13n", n128, compute);
  check_steps("centernet", center, compute);
#ifdef SEGSIM_CHECK_SHARED_STREAM
  if (cuda) check_shared_stream(small, device);
#endif
  if (with_times && cuda) {
    time_inference("small", small, device);
    for (const Scale scale : {Scale::kN, Scale::kS}) {
      const DetectorWeights weights = lively_yolo(scale, 640);
      const std::string name = scale == Scale::kN ? "yolov13n" : "yolov13s";
      time_inference(name, weights, device);
      time_training(name, weights, 16);
    }
    time_training("small", small, 8);
    const DetectorWeights center320 = lively_weights(DetectorWeights::kCenterNet, 80, 320);
    time_inference("centernet", center320, device);
    time_training("centernet", center320, 4);
  }
  std::printf(failures() == 0 ? "all cases hold\n" : "%d cases FAIL\n", failures());
  return failures() == 0 ? 0 : 1;
}

}  // namespace
}  // namespace segsim::perception::checks

int main(int argc, char** argv) {
  using segsim::perception::ComputeDevice;
  try {
    const std::string word = argc > 1 ? argv[1] : "";
    return segsim::perception::checks::run_all(
        word == "cpu" ? ComputeDevice::kCpu : ComputeDevice::kCuda, word != "quick");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "detector_check: %s\n", error.what());
    return 1;
  }
}
