#include <cmath>
#include <cstdio>
#include <memory>

#include "checks.h"
#include "perception/detector/device_frame_tensors.h"
#include "perception/detector/internal/frame_stream.h"
#include "renderer/cuda/cuda_renderer.h"
#include "renderer/scene/room_scene.h"

namespace segsim::perception::checks {

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
    const RawOutput wanted =
        to_cpu(make_inference_network(weights, "cpu")(input.to(torch::kCPU)));
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

}  // namespace segsim::perception::checks
