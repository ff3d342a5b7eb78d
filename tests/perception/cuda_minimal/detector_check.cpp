/// @file
/// Compares the detectors' networks on CUDA with those on the CPU, and times them. A test
/// program of its own, because the machine that it runs on has no test framework. Exit code 1
/// if a case fails.
///
///     detector_check [cpu|quick]      cpu: the CPU takes the GPU's place, to try the program;
///                                     quick: no times but those of the shared stream

#include <torch/torch.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <functional>
#include <string>
#include <vector>

#include "core/random.h"
#include "perception/device_frame_tensors.h"
#include "perception/internal/detection_loss.h"
#include "perception/internal/frame_stream.h"
#include "perception/internal/inference.h"
#include "perception/internal/torch_device.h"
#include "perception/internal/training_step.h"
#include "perception/nms.h"
#include "perception/yolov13/scale.h"
#ifdef SEGSIM_WITH_CUDA
#include "renderer/cuda/cuda_renderer.h"
#include "renderer/room_scene.h"
#endif

namespace segsim::perception {
namespace {

int failures = 0;

void expect_below(const std::string& what, double value, double limit) {
  const bool holds = value <= limit;  // False for a NaN.
  std::printf("%-4s %-62s %.3g (at most %.3g)\n", holds ? "ok" : "FAIL", what.c_str(), value,
              limit);
  std::fflush(stdout);
  failures += holds ? 0 : 1;
}

double largest_difference(const torch::Tensor& a, const torch::Tensor& b) {
  return (a.to(torch::kCPU, torch::kFloat64) - b.to(torch::kCPU, torch::kFloat64))
      .abs()
      .max()
      .item<double>();
}

/// Weights under which all layers matter: statistics and gates moved from where they start.
DetectorWeights lively_weights(const std::string& architecture, int classes, int input_px) {
  const auto network = make_trainable_network(architecture, 0.5, classes, input_px, 7);
  DetectorWeights weights;
  weights.architecture = architecture;
  weights.width = 0.5;
  weights.input_px = input_px;
  for (int c = 0; c < classes; ++c) weights.class_names.push_back("c" + std::to_string(c));
  weights.tensors = export_tensors(*network.module);
  for (NamedTensor& tensor : weights.tensors) {
    core::RandomStream random(11, "lively/" + tensor.name);
    const auto ends = [&](const char* end) {
      const std::string& name = tensor.name;
      return name.size() >= std::strlen(end) && name.ends_with(end);
    };
    if (ends("gate") || ends("running_var")) {
      for (float& value : tensor.values) value = static_cast<float>(random.uniform(0.6, 1.4));
    } else if (ends("running_mean")) {
      for (float& value : tensor.values) value = static_cast<float>(random.uniform(-0.2, 0.2));
    }
  }
  return weights;
}

std::string yolo(yolov13::Scale scale) { return yolov13::architecture_of(scale); }

torch::Tensor noise(int batch, int side_px) {
  torch::manual_seed(5);
  return torch::rand({batch, 3, side_px, side_px});
}

RawOutput to_cpu(const RawOutput& output) {
  return {output.box.to(torch::kCPU, torch::kFloat32),
          output.classes.to(torch::kCPU, torch::kFloat32)};
}

/// Boxes are compared by the documented bound of the port: 1e-3 px, scores 1e-5.
void check_forward(const std::string& name, const DetectorWeights& weights, int batch,
                   const torch::Device& device) {
  const torch::InferenceMode inference;
  const auto on_cpu = make_inference_network(weights, name);
  const auto on_device = make_inference_network(weights, name, device);
  const auto input = noise(batch, weights.input_px);
  const RawOutput wanted = on_cpu(input), found = to_cpu(on_device(input.to(device)));
  const Anchors anchors = make_anchors(weights.input_px, torch::TensorOptions(torch::kCPU));
  expect_below(
      name + " forward, batch " + std::to_string(batch) + ", boxes [px]",
      largest_difference(decode_boxes(found.box, anchors), decode_boxes(wanted.box, anchors)),
      1e-3);
  expect_below(name + " forward, scores",
               largest_difference(found.classes.sigmoid(), wanted.classes.sigmoid()), 1e-5);
}

std::vector<std::vector<LabeledBox>> some_truth(int batch, int classes, int side_px) {
  std::vector<std::vector<LabeledBox>> truth(static_cast<std::size_t>(batch));
  core::RandomStream random(3, "truth");
  for (auto& boxes : truth) {
    for (int i = 0; i < 6; ++i) {
      LabeledBox box;
      box.class_index = static_cast<int>(random.index(static_cast<std::uint32_t>(classes)));
      const auto at = [&](double low, double high) {
        return static_cast<float>(random.uniform(low, high) * side_px);
      };
      const float x = at(0.0, 0.6), y = at(0.0, 0.6);
      box.box = {x, y, x + at(0.1, 0.4), y + at(0.1, 0.4)};
      box.ignore = i == 5;
      boxes.push_back(box);
    }
  }
  return truth;
}

void check_loss(const std::string& name, const DetectorWeights& weights,
                const torch::Device& device) {
  const int classes = static_cast<int>(weights.class_names.size());
  RawOutput raw;
  {
    const torch::NoGradGuard no_grad;
    raw = make_inference_network(weights, name)(noise(2, weights.input_px));
  }
  const auto truth = some_truth(2, classes, weights.input_px);
  struct Result {
    std::vector<double> parts;
    torch::Tensor box_gradient, class_gradient;
  };
  const auto run = [&](const torch::Device& where) {
    RawOutput own{raw.box.detach().to(where).clone().requires_grad_(true),
                  raw.classes.detach().to(where).clone().requires_grad_(true)};
    const LossParts parts =
        detection_loss(own, make_anchors(weights.input_px, torch::TensorOptions(where)), truth,
                       AssignerRule{});
    (parts.box + parts.classes + parts.bins).backward();
    return Result{
        {parts.box.item<double>(), parts.classes.item<double>(), parts.bins.item<double>()},
        own.box.grad(),
        own.classes.grad()};
  };
  const Result cpu = run(torch::kCPU), other = run(device);
  double worst = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    worst = std::max(worst, std::abs(cpu.parts[i] - other.parts[i]) / cpu.parts[i]);
  }
  expect_below(name + " loss, relative", worst, 1e-5);
  expect_below(name + " loss, gradient of the boxes",
               largest_difference(cpu.box_gradient, other.box_gradient), 1e-6);
  expect_below(name + " loss, gradient of the classes",
               largest_difference(cpu.class_gradient, other.class_gradient), 1e-6);
}

TrainOptions step_options(ComputeDevice device, bool mixed, int input_px, int batch) {
  TrainOptions options;
  options.input_px = input_px;
  options.batch = batch;
  options.steps = 200;
  options.warmup_steps = 5;
  options.device = device;
  options.mixed_precision = mixed;
  return options;
}

/// Trains on one batch. @returns the losses per image.
std::vector<double> losses_of(const DetectorWeights& weights, const TrainOptions& options,
                              int steps, double* ms_per_step = nullptr) {
  const int classes = static_cast<int>(weights.class_names.size());
  const auto network = [&] {
    auto result = make_trainable_network(weights.architecture, weights.width, classes,
                                         options.input_px, options.seed);
    import_tensors(*result.module, weights.tensors, "check");
    return result;
  };
  TrainingStep training(options, network(), network(), false);
  const auto pixels = noise(options.batch, options.input_px);
  const auto truth = some_truth(options.batch, classes, options.input_px);
  const float* first = pixels.data_ptr<float>();
  const auto make = [&](std::int64_t, Batch& batch) {
    batch.pixels.assign(first, first + pixels.numel());
    batch.truth = truth;
  };
  std::vector<double> losses;
  constexpr int kWarm = 3;
  auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < steps; ++i) {
    if (i == kWarm) begin = std::chrono::steady_clock::now();
    losses.push_back(training.advance(make).value_or(std::nan("")));
  }
  if (ms_per_step != nullptr) {
    const std::chrono::duration<double, std::milli> wall =
        std::chrono::steady_clock::now() - begin;
    *ms_per_step = wall.count() / (steps - kWarm);
  }
  return losses;
}

void check_steps(const std::string& name, const DetectorWeights& weights,
                 ComputeDevice device) {
  constexpr int kSteps = 4, kSide_px = 128, kBatch = 4;
  const auto cpu =
      losses_of(weights, step_options(ComputeDevice::kCpu, false, kSide_px, kBatch), kSteps);
  const auto other = losses_of(weights, step_options(device, false, kSide_px, kBatch), kSteps);
  // Dropout draws from another generator on CUDA: only the small network has none. Later
  // steps: AdamW turns the sign of a derivative near zero into a whole step.
  const bool exact = weights.architecture == DetectorWeights::kArchitecture;
  for (int i = 0; i < kSteps; ++i) {
    expect_below(name + " step " + std::to_string(i + 1) + ", loss, relative",
                 std::abs(cpu[i] - other[i]) / cpu[i],
                 !exact   ? 5e-2
                 : i == 0 ? 1e-4
                          : 1e-2);
  }
  if (device == ComputeDevice::kCpu) return;
  constexpr int kMany = 60;
  const auto plain = losses_of(weights, step_options(device, false, kSide_px, kBatch), kMany);
  const auto mixed = losses_of(weights, step_options(device, true, kSide_px, kBatch), kMany);
  expect_below(name + " mixed precision, first loss, relative",
               std::abs(plain[0] - mixed[0]) / plain[0], 1e-2);
  expect_below(name + " mixed precision, loss after 60 steps over that at first",
               mixed.back() / mixed.front(), 0.8);
  expect_below(name + " loss after 60 steps, mixed over full precision",
               mixed.back() / plain.back(), 1.5);
}

/// The score that so many pairs of the output reach.
float score_of_rank(const RawOutput& output, int64_t rank) {
  const auto sorted = std::get<0>(output.classes.sigmoid().flatten().sort(0, true));
  return sorted[rank].item<float>();
}

double worst_difference(const Candidates& a, const Candidates& b) {
  if (a.size() != b.size()) return 1e9;
  double worst = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i].class_index != b[i].class_index) return 1e9;
    for (const float d :
         {a[i].box.x0 - b[i].box.x0, a[i].box.y0 - b[i].box.y0, a[i].box.x1 - b[i].box.x1,
          a[i].box.y1 - b[i].box.y1, 100.0F * (a[i].score - b[i].score)}) {
      worst = std::max(worst, std::abs(static_cast<double>(d)));
    }
  }
  return worst;
}

void check_decoding(const DetectorWeights& weights, const torch::Device& device) {
  const torch::InferenceMode inference;
  const RawOutput raw =
      make_inference_network(weights, "decoding")(noise(3, weights.input_px));
  // Between two scores, so that rounding does not decide.
  const float threshold = 0.5F * (score_of_rank(raw, 500) + score_of_rank(raw, 501)) + 1e-9F;
  const auto host = candidates_on_host(
      raw, make_anchors(weights.input_px, torch::TensorOptions(torch::kCPU)), threshold);
  const auto other = candidates_on_device(
      {raw.box.to(device), raw.classes.to(device)},
      make_anchors(weights.input_px, torch::TensorOptions(device)), threshold);
  double worst = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < host.size(); ++i) {
    worst = std::max(worst, worst_difference(host[i], other[i]));
    count += host[i].size();
  }
  expect_below("decoding of " + std::to_string(count) + " candidates, boxes [px]", worst,
               1e-2);
}

double median_ms(const torch::Device& device, int rounds, const std::function<void()>& work) {
  const auto wait = [&] {
    if (!device.is_cpu()) torch::cuda::synchronize();
  };
  for (int i = 0; i < 5; ++i) work();
  wait();
  std::vector<double> times_ms;
  for (int i = 0; i < rounds; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    wait();
    times_ms.push_back(
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
            .count());
  }
  std::sort(times_ms.begin(), times_ms.end());
  return times_ms[times_ms.size() / 2];
}

#ifdef SEGSIM_WITH_CUDA
/// Views of the standard room drawn by the GPU, detected where they lie.
void check_shared_stream(const DetectorWeights& weights, const torch::Device& device) {
  constexpr int kRobots = 8;
  const auto room = std::make_shared<const renderer::SurfelCloud>(
      renderer::make_room_scene({.surfel_count = 200'000}));
  const auto gpu = renderer::make_cuda_renderer(room, {});
  const core::CameraIntrinsics camera =
      core::CameraIntrinsics::from_fov(320, 240, 79.0 * 3.14159265358979 / 180.0);
  const auto poses = [&](int round) {
    std::vector<core::CameraPose> result;
    for (int i = 0; i < kRobots; ++i) {
      const double angle = 0.7 * i + 0.05 * round;
      const glm::dvec3 eye{4.0, 3.0, 1.2};
      result.push_back(
          core::look_at(eye, eye + glm::dvec3{std::cos(angle), std::sin(angle), -0.1}));
    }
    return result;
  };
  const Letterbox fit = Letterbox::fit(320, 240, weights.input_px);
  Inference on_gpu(make_inference_network(weights, "gpu", device), weights.input_px, device,
                   false);
  Inference on_cpu(make_inference_network(weights, "cpu"), weights.input_px, torch::kCPU,
                   false);
  const auto detect = [&](const core::DeviceFrames& frames, float threshold) {
    const FrameStreamScope stream(frames);
    return on_gpu.candidates(
        on_gpu.letterbox_on_device(image_tensor(frames, DeviceImage::kRgb), fit), threshold);
  };
  std::printf("renderer's pictures, %d robots\n", kRobots);
  const core::DeviceFrames& frames = gpu->render_batch(poses(0), camera, core::Channels::kRgb);
  gpu->wait();
  expect_below("a view of the renderer's memory, bytes copied",
               image_tensor(frames, DeviceImage::kRgb).data_ptr() == frames.rgb ? 0.0 : 1.0,
               0.0);
  // The same pictures by way of the host. 320 px shrink to 256 with exact halves between two
  // levels, which rounding may send either way.
  {
    const torch::InferenceMode inference;
    const FrameStreamScope stream(frames);
    const auto bytes = image_tensor(frames, DeviceImage::kRgb);
    const auto input = on_gpu.letterbox_on_device(bytes, fit);
    expect_below("letterbox on the GPU and on the CPU, levels",
                 255.0 * largest_difference(
                             input, on_cpu.letterbox_on_device(bytes.to(torch::kCPU), fit)),
                 1.001);
    const RawOutput found = to_cpu(make_inference_network(weights, "gpu", device)(input));
    const RawOutput wanted = make_inference_network(weights, "cpu")(input.to(torch::kCPU));
    const Anchors anchors = make_anchors(weights.input_px, torch::TensorOptions(torch::kCPU));
    expect_below("renderer's pictures in the renderer's stream, boxes [px]",
                 largest_difference(decode_boxes(found.box, anchors),
                                    decode_boxes(wanted.box, anchors)),
                 1e-3);
    expect_below("renderer's pictures in the renderer's stream, scores",
                 largest_difference(found.classes.sigmoid(), wanted.classes.sigmoid()), 1e-5);
    const float threshold = score_of_rank(wanted, 800);
    // Drawing and detecting without a wait of the host gives what waiting gives.
    double worst = 0.0;
    for (int round = 0; round < 20; ++round) {
      const auto& next = gpu->render_batch(poses(round), camera, core::Channels::kRgb);
      gpu->wait();
      torch::cuda::synchronize();
      const auto calm = detect(next, threshold);
      torch::cuda::synchronize();
      const auto hasty =
          detect(gpu->render_batch(poses(round), camera, core::Channels::kRgb), threshold);
      gpu->wait();
      for (std::size_t i = 0; i < calm.size(); ++i) {
        worst = std::max(worst, worst_difference(calm[i], hasty[i]));
      }
    }
    expect_below("without a wait between drawing and detecting, boxes [px]", worst, 0.0);
  }
  const double render_ms = median_ms(device, 40, [&] {
    (void)gpu->render_batch(poses(0), camera, core::Channels::kRgb);
    gpu->wait();
  });
  const double both_ms = median_ms(device, 40, [&] {
    (void)detect(gpu->render_batch(poses(0), camera, core::Channels::kRgb), 0.9F);
    gpu->wait();
  });
  const double host_ms = median_ms(device, 40, [&] {
    const auto& drawn = gpu->render_batch(poses(0), camera, core::Channels::kRgb);
    gpu->wait();
    const auto bytes = image_tensor(drawn, DeviceImage::kRgb).to(torch::kCPU);
    (void)on_gpu.candidates(on_gpu.letterbox_on_device(bytes.to(device), fit), 0.9F);
  });
  std::printf(
      "time %d robots 320x240: draw %.3f ms; draw and detect in one stream %.3f ms; by way of "
      "the host's memory %.3f ms\n",
      kRobots, render_ms, both_ms, host_ms);
}
#endif

void time_inference(const std::string& name, const DetectorWeights& weights,
                    const torch::Device& device) {
  for (const bool mixed : {false, true}) {
    if (mixed && device.is_cpu()) continue;
    Inference inference(make_inference_network(weights, name, device), weights.input_px,
                        device, mixed);
    for (const int batch : {1, 8, 16}) {
      const std::vector<core::Image<core::Rgb8>> squares(
          static_cast<std::size_t>(batch),
          core::Image<core::Rgb8>(weights.input_px, weights.input_px, {90, 120, 70}));
      const auto input = inference.upload(squares);
      const int rounds = device.is_cpu() ? 3 : 30;
      const double network_ms =
          median_ms(device, rounds, [&] { (void)inference.candidates(input, 0.9F); });
      const double upload_ms =
          median_ms(device, rounds, [&] { (void)inference.upload(squares); });
      const double pageable_ms = median_ms(device, rounds, [&] {
        (void)torch::empty({batch, 3, weights.input_px, weights.input_px}).to(device);
      });
      std::printf(
          "time %s %d px, %s, batch %2d: network and decoding %.3f ms (%.3f an image), upload "
          "%.3f ms (pageable floats %.3f)\n",
          name.c_str(), weights.input_px, mixed ? "mixed" : "float32", batch, network_ms,
          network_ms / batch, upload_ms, pageable_ms);
      std::fflush(stdout);
      if (device.is_cpu()) return;
    }
  }
}

void time_training(const std::string& name, const DetectorWeights& weights, int batch) {
  for (const bool mixed : {false, true}) {
    double ms = 0.0;
    (void)losses_of(
        weights, step_options(ComputeDevice::kCuda, mixed, weights.input_px, batch), 15, &ms);
    std::printf("time %s training step, %d px, batch %d, %s: %.1f ms\n", name.c_str(),
                weights.input_px, batch, mixed ? "mixed" : "float32", ms);
    std::fflush(stdout);
  }
}

int run(ComputeDevice compute, bool with_times) {
  using yolov13::Scale;
  at::set_num_threads(8);
  const torch::Device device = torch_device(compute, "check");
  const bool cuda = compute == ComputeDevice::kCuda;
  const DetectorWeights small = lively_weights(DetectorWeights::kArchitecture, 12, 256);
  const DetectorWeights n128 = lively_weights(yolo(Scale::kN), 80, 128);
  check_forward("small", small, 3, device);
  check_forward("yolov13n", n128, 2, device);
  if (cuda) {
    check_forward("yolov13n 640", lively_weights(yolo(Scale::kN), 80, 640), 1, device);
    check_forward("yolov13s 320", lively_weights(yolo(Scale::kS), 80, 320), 1, device);
    check_forward("yolov13l 128", lively_weights(yolo(Scale::kL), 80, 128), 1, device);
    check_forward("yolov13x 128", lively_weights(yolo(Scale::kX), 80, 128), 1, device);
  }
  check_loss("small", small, device);
  check_loss("yolov13n", n128, device);
  check_decoding(small, device);
  check_decoding(n128, device);
  check_steps("small", small, compute);
  check_steps("yolov13n", n128, compute);
#ifdef SEGSIM_WITH_CUDA
  if (cuda) check_shared_stream(small, device);
#endif
  if (with_times) time_inference("small", small, device);
  if (with_times && cuda) {
    for (const Scale scale : {Scale::kN, Scale::kS}) {
      const DetectorWeights weights = lively_weights(yolo(scale), 80, 640);
      const std::string name = scale == Scale::kN ? "yolov13n" : "yolov13s";
      time_inference(name, weights, device);
      time_training(name, weights, 16);
    }
    time_training("small", small, 8);
  }
  std::printf(failures == 0 ? "all cases hold\n" : "%d cases FAIL\n", failures);
  return failures == 0 ? 0 : 1;
}

}  // namespace
}  // namespace segsim::perception

int main(int argc, char** argv) {
  using segsim::perception::ComputeDevice;
  try {
    const std::string word = argc > 1 ? argv[1] : "";
    return segsim::perception::run(word == "cpu" ? ComputeDevice::kCpu : ComputeDevice::kCuda,
                                   word != "quick");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "detector_check: %s\n", error.what());
    return 1;
  }
}
