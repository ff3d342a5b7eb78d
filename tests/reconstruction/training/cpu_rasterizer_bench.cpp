/// @file
/// Milliseconds of the forward and the backward pass in a furnished room of 150 thousand
/// surfels, from a camera that turns in its middle.

#include <benchmark/benchmark.h>

#include <cmath>
#include <memory>

#include "core/frames.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "tests/reconstruction/training/training_surfels.h"
#include "tests/renderer/scenes.h"

namespace segsim::reconstruction {
namespace {

using testing::OwnedGradients;
using testing::OwnedImages;
using testing::OwnedSurfels;

/// The room with SH coefficients of the degree.
const OwnedSurfels<float>& room(int sh_degree) {
  static OwnedSurfels<float> rooms[4];
  OwnedSurfels<float>& surfels = rooms[sh_degree];
  if (surfels.count() > 0) return surfels;
  surfels = testing::parameters_of<float>(renderer::testing::room_scene(0.0323F));
  core::RandomStream random(1, "room");
  const auto coefficients = static_cast<std::size_t>((sh_degree + 1) * (sh_degree + 1));
  std::vector<float> sh(surfels.opacity_logit.size() * coefficients * 3);
  for (std::size_t i = 0; i < sh.size(); ++i) {
    const std::size_t k = i % (3 * coefficients), surfel = i / (3 * coefficients);
    sh[i] = k < 3 ? surfels.sh[3 * surfel + k] : 0.1F * static_cast<float>(random.normal());
  }
  surfels.sh = std::move(sh);
  surfels.sh_degree = surfels.active_sh_degree = sh_degree;
  return surfels;
}

core::CameraPose turning_camera(int step) {
  const double angle_rad = 0.37 * step;
  const glm::dvec3 eye_m(3.0 + 0.6 * std::cos(0.11 * step), 2.5 + 0.5 * std::sin(0.13 * step),
                         1.2);
  return core::look_at(eye_m,
                       eye_m + glm::dvec3(std::cos(angle_rad), std::sin(angle_rad), -0.15));
}

enum Passes { kForward, kForwardAndBackward, kWeights };

void passes(benchmark::State& state, Passes passes, int width_px, int height_px, int sh_degree,
            int threads) {
  const OwnedSurfels<float>& surfels = room(sh_degree);
  const auto camera = core::CameraIntrinsics::from_fov(width_px, height_px, 1.2);
  const auto rasterizer = make_cpu_rasterizer<float>({threads});
  OwnedImages<float> images(camera);
  const OwnedImages<float> loss = testing::random_loss<float>(1, camera);
  OwnedGradients<float> gradients(surfels);
  std::vector<float> max_weight(surfels.opacity_logit.size());
  std::vector<std::int32_t> pixels(images.area());
  for (std::size_t p = 0; p < pixels.size(); ++p) pixels[p] = static_cast<std::int32_t>(p);
  int step = 0;
  for (auto _ : state) {
    rasterizer->forward(surfels.view(), camera, turning_camera(++step), images.view(),
                        max_weight.data());
    if (passes == kForwardAndBackward) {
      rasterizer->backward(surfels.view(), loss.const_view(), gradients.view());
    } else if (passes == kWeights) {
      const PixelWeights weights =
          rasterizer->weights(pixels.data(), static_cast<std::int64_t>(pixels.size()), 8);
      state.counters["weights"] = static_cast<double>(weights.entries);
    }
  }
  state.counters["surfels"] = static_cast<double>(surfels.count());
}

void register_all() {
  const char* names[] = {"forward", "forward_backward", "forward_weights"};
  for (const Passes which : {kForward, kForwardAndBackward, kWeights}) {
    for (const int width_px : {320, 640}) {
      for (const int sh_degree : {0, 3}) {
        for (const int threads : {1, 2}) {
          const std::string name = std::string(names[which]) + "/" + std::to_string(width_px) +
                                   "/sh:" + std::to_string(sh_degree) +
                                   "/threads:" + std::to_string(threads);
          benchmark::RegisterBenchmark(name.c_str(),
                                       [=](benchmark::State& state) {
                                         passes(state, which, width_px, width_px * 3 / 4,
                                                sh_degree, threads);
                                       })
              ->Unit(benchmark::kMillisecond)
              ->MeasureProcessCPUTime()
              ->UseRealTime();
        }
      }
    }
  }
}

const bool registered = (register_all(), true);

}  // namespace
}  // namespace segsim::reconstruction
