/// @file
/// Frames per second in a furnished room of opaque surfels, from a camera that turns in its
/// middle.

#include <benchmark/benchmark.h>

#include <memory>

#include "core/frames.h"
#include "renderer/cpu_renderer.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer {
namespace {

using core::Channels;

std::shared_ptr<const SurfelCloud> room() {
  static const auto scene = std::make_shared<const SurfelCloud>(testing::room_scene(0.02F));
  return scene;
}

core::CameraPose turning_camera(int step) {
  const double angle_rad = 0.37 * step;
  const glm::dvec3 eye_m(3.0 + 0.6 * std::cos(0.11 * step), 2.5 + 0.5 * std::sin(0.13 * step),
                         1.2);
  return core::look_at(eye_m,
                       eye_m + glm::dvec3(std::cos(angle_rad), std::sin(angle_rad), -0.15));
}

/// @param threads  As in RenderOptions.
void render_room(benchmark::State& state, int width_px, int height_px, Channels channels,
                 int threads) {
  RenderOptions options;
  options.threads = threads;
  const auto renderer = make_cpu_renderer(room(), options);
  const auto intrinsics = core::CameraIntrinsics::from_fov(width_px, height_px, 1.2);
  core::Frame frame;
  renderer->render(turning_camera(0), intrinsics, channels, frame);  // First allocations.
  int step = 0;
  double projected = 0, pairs = 0, touched = 0, evaluations = 0, contributions = 0;
  for (auto _ : state) {
    renderer->render(turning_camera(++step), intrinsics, channels, frame);
    benchmark::DoNotOptimize(frame.alpha.data());
    projected += static_cast<double>(frame.stats.surfels_projected);
    pairs += static_cast<double>(frame.stats.pairs_binned);
    touched += static_cast<double>(frame.stats.pairs_touched);
    evaluations += static_cast<double>(frame.stats.evaluations);
    contributions += static_cast<double>(frame.stats.contributions);
  }
  const auto mean = [](double sum) {
    return benchmark::Counter(sum, benchmark::Counter::kAvgIterations);
  };
  state.counters["fps"] =
      benchmark::Counter(1.0, benchmark::Counter::kIsIterationInvariantRate);
  state.counters["surfels"] = static_cast<double>(room()->size());
  state.counters["projected"] = mean(projected);
  state.counters["pairs"] = mean(pairs);
  state.counters["touched"] = mean(touched);
  const double pixels = static_cast<double>(width_px) * height_px;
  state.counters["evaluations_px"] = mean(evaluations / pixels);
  state.counters["contributions_px"] = mean(contributions / pixels);
}

void register_case(const std::string& name, int width_px, int height_px, Channels channels,
                   int threads) {
  benchmark::RegisterBenchmark(
      (name + (threads == 1 ? "/one_thread" : "/all_threads")).c_str(),
      [=](benchmark::State& state) {
        render_room(state, width_px, height_px, channels, threads);
      })
      ->Unit(benchmark::kMillisecond)
      ->UseRealTime();
}

const bool kRegistered = [] {
  for (const int threads : {1, 0}) {
    register_case("room/256x192/all", 256, 192, Channels::kAll, threads);
    register_case("room/320x240/all", 320, 240, Channels::kAll, threads);
    register_case("room/320x240/rgbd", 320, 240, Channels::kRgbd, threads);
    register_case("room/320x240/labels", 320, 240, Channels::kLabels, threads);
    register_case("room/640x480/all", 640, 480, Channels::kAll, threads);
  }
  return true;
}();

}  // namespace
}  // namespace segsim::renderer
