/// @file
/// Times of the differentiable rasterizer on the standard room, by device events around each
/// call, as docs/results/rendering.md has them. The table goes to the error stream, a record
/// for results/ to the output.
///
///     training_bench [frames [one]]      48 views a row without; one: only 1 M, 640x480

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string>
#include <vector>

#include "core/process/measurement_record.h"
#include "reconstruction/rasterizer/cuda/cuda_rasterizer.h"
#include "renderer/scene/room_scene.h"
#include "tests/renderer/cuda_minimal/device_training.h"

namespace segsim::renderer {
namespace {

using testing::DeviceGradients;
using testing::DeviceSurfels;
using testing::DeviceTrainingImages;

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// @param sh_degree  Coefficients above 0 are zeros, which cost as much as others.
DeviceSurfels make_surfels(int count, double spread, int sh_degree) {
  RoomSceneOptions options;
  options.surfel_count = count;
  options.spread = spread;
  auto surfels = reconstruction::testing::parameters_of<float>(make_room_scene(options));
  const std::size_t stored = 3 * static_cast<std::size_t>((sh_degree + 1) * (sh_degree + 1));
  std::vector<float> sh(surfels.opacity_logit.size() * stored, 0.0F);
  for (std::size_t i = 0; i < surfels.opacity_logit.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) sh[stored * i + k] = surfels.sh[3 * i + k];
  }
  surfels.sh = std::move(sh);
  surfels.sh_degree = surfels.active_sh_degree = sh_degree;
  return DeviceSurfels(surfels);
}

void run(const std::string& name, const DeviceSurfels& surfels, int width_px, int height_px,
         int frames, bool deterministic, core::MeasurementRecord& out,
         std::optional<core::MeasurementGoal> together_goal = {}) {
  const core::CameraIntrinsics camera = room_camera(width_px, height_px);
  const std::vector<core::CameraPose> ring = room_camera_ring(frames);
  const DeviceTrainingImages images(camera),
      loss(reconstruction::testing::random_loss<float>(1, camera));
  const DeviceGradients gradients(surfels);
  const auto gpu = reconstruction::make_cuda_rasterizer({.deterministic = deterministic});
  const cuda::Event start, middle, end;
  std::vector<double> forward_ms, backward_ms;
  const auto record = [](const cuda::Event& event) {
    cuda::throw_on_error(cudaEventRecord(event.get(), nullptr), "cudaEventRecord");
  };
  const auto between = [](const cuda::Event& a, const cuda::Event& b) {
    float ms = 0.0F;
    cuda::throw_on_error(cudaEventElapsedTime(&ms, a.get(), b.get()), "cudaEventElapsedTime");
    return static_cast<double>(ms);
  };
  constexpr int kWarmUp = 4;
  for (int frame = -kWarmUp; frame < frames; ++frame) {
    const core::CameraPose& pose = ring[static_cast<std::size_t>((frame + kWarmUp) % frames)];
    record(start);
    gpu->forward(surfels.view(), camera, pose, images.view(), gradients.max_weight.data());
    record(middle);
    gpu->backward(surfels.view(), loss.view<const float>(), gradients.view());
    record(end);
    cuda::throw_on_error(cudaEventSynchronize(end.get()), "cudaEventSynchronize");
    if (frame < 0) continue;
    forward_ms.push_back(between(start, middle));
    backward_ms.push_back(between(middle, end));
  }
  const double forward = median(forward_ms), backward = median(backward_ms);
  const std::string row = name + ", " + std::to_string(width_px) + "x" +
                          std::to_string(height_px) +
                          (deterministic ? ", in fixed order" : "");
  std::fprintf(stderr, "%-56s forward %6.3f backward %6.3f together %6.3f ms\n", row.c_str(),
               forward, backward, forward + backward);
  out.values.push_back({row, "forward", "ms", forward});
  out.values.push_back({row, "backward", "ms", backward});
  out.values.push_back({row, "together", "ms", forward + backward, together_goal});
}

void run_all(int frames, bool one, core::MeasurementRecord& out) {
  struct Scene {
    const char* name;
    int surfels;
    double spread;
    int sh_degree;
  };
  const Scene scenes[] = {{"300 k, spread 1.6, degree 3", 300'000, 1.6, 3},
                          {"1 M, spread 1.0, degree 3", 1'000'000, 1.0, 3},
                          {"1 M, spread 1.6, degree 3", 1'000'000, 1.6, 3}};
  for (const Scene& scene : scenes) {
    if (one && (scene.surfels != 1'000'000 || scene.spread != 1.0)) continue;
    const DeviceSurfels surfels = make_surfels(scene.surfels, scene.spread, scene.sh_degree);
    const core::MeasurementGoal goal{core::MeasurementGoal::Kind::kAtMost, 2.5, {}};
    run(scene.name, surfels, 640, 480, frames, false, out,
        scene.surfels == 1'000'000 ? std::optional(goal) : std::nullopt);
    if (one) continue;
    run(scene.name, surfels, 1296, 968, frames, false, out);
    if (scene.spread == 1.0) run(scene.name, surfels, 640, 480, frames, true, out);
  }
}

}  // namespace
}  // namespace segsim::renderer

int main(int argc, char** argv) {
  try {
    segsim::core::MeasurementRecord record{"Forward and backward on the GPU", true, {}};
    segsim::renderer::run_all(argc > 1 ? std::max(1, std::atoi(argv[1])) : 48, argc > 2,
                              record);
    std::fputs(segsim::core::record_text(record).c_str(), stdout);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "training_bench: %s\n", error.what());
    return 2;
  }
}
