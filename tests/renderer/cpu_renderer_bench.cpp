/// @file
/// Frames per second in a furnished room of opaque surfels, from a camera that turns in its
/// middle; and the stages of a frame by themselves, on one thread.

#include <benchmark/benchmark.h>

#include <array>
#include <bit>
#include <memory>
#include <utility>
#include <vector>

#include "core/frames.h"
#include "renderer/cpu_renderer.h"
#include "renderer/raster/label_vote.h"
#include "renderer/raster/tile_state.h"
#include "tests/renderer/make_key.h"
#include "tests/renderer/scenes.h"
#include "tests/renderer/view_stages.h"

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

/// A view of 640 x 480 px.
testing::ViewStages standard_view() {
  return {room(), turning_camera(3), core::CameraIntrinsics::from_fov(640, 480, 1.2)};
}

benchmark::Counter per_second(double count) {
  return {count, benchmark::Counter::kIsIterationInvariantRate};
}

/// Culling, projection and the rows of tiles; nothing is entered in a list.
void project_view(benchmark::State& state) {
  testing::ViewStages stages = standard_view();
  for (auto _ : state) stages.project_only();
  state.counters["surfels_per_s"] = per_second(static_cast<double>(stages.surfel_count()));
}
BENCHMARK(project_view)->Name("stage/project")->Unit(benchmark::kMillisecond);

/// The same with the tiles' entries: the difference is what they cost.
void project_and_bin_view(benchmark::State& state) {
  testing::ViewStages stages = standard_view();
  for (auto _ : state) stages.project();
  state.counters["pairs_per_s"] = per_second(static_cast<double>(stages.bins.pair_count()));
}
BENCHMARK(project_and_bin_view)->Name("stage/project_and_bin")->Unit(benchmark::kMillisecond);

/// From the tiles' entries to lists in order of depth.
void bin_view(benchmark::State& state) {
  testing::ViewStages stages = standard_view();
  for (auto _ : state) {
    state.PauseTiming();
    stages.project();
    state.ResumeTiming();
    stages.list();
  }
  state.counters["pairs_per_s"] = per_second(static_cast<double>(stages.bins.pair_count()));
}
BENCHMARK(bin_view)->Name("stage/bin")->Unit(benchmark::kMillisecond);

/// All tiles of a view, with the writing of their pixels; @param channels  What is written.
void raster_view(benchmark::State& state, Channels channels) {
  testing::ViewStages stages = standard_view();
  stages.project();
  stages.list();
  internal::TileStats stats;
  for (auto _ : state) stats = stages.raster(channels);
  state.counters["evaluations_per_s"] = per_second(static_cast<double>(stats.evaluations));
  state.counters["rows_per_s"] = per_second(static_cast<double>(stats.feature_fetches));
}
BENCHMARK_CAPTURE(raster_view, rgbd_normal, Channels::kRgbd | Channels::kNormal)
    ->Name("stage/raster")
    ->Unit(benchmark::kMillisecond);
/// The Top-K and its labels too: the difference is what they cost.
BENCHMARK_CAPTURE(raster_view, all, Channels::kAll)
    ->Name("stage/raster_and_resolve")
    ->Unit(benchmark::kMillisecond);

/// Votes of rows of 16 pixels, four candidates of at most three labels each.
void resolve_rows(benchmark::State& state) {
  constexpr std::size_t kRow = 16, kRanks = 4, kSlots = 64;
  core::RandomStream random(4, "resolve_rows");
  std::vector<internal::SurfelShade> shade(kSlots);
  std::vector<std::uint32_t> slots(kSlots);
  for (std::size_t i = 0; i < kSlots; ++i) {
    slots[i] = static_cast<std::uint32_t>(i);
    shade[i].label = 1 + static_cast<std::uint32_t>(random.index(3)) * 0x10001U;
  }
  alignas(64) std::array<std::uint32_t, kRow * kRanks> keys{};
  for (std::size_t k = 0; k < kRanks; ++k) {
    for (std::size_t i = 0; i < kRow; ++i) {
      const float weight = 0.5F / static_cast<float>(k + 1);
      keys[k * kRow + i] =
          internal::make_key(weight, static_cast<std::uint32_t>(random.index(kSlots)));
    }
  }
  std::array<std::uint16_t, kRow> semantic{}, instance{};
  std::array<float, kRow> confidence{}, instance_confidence{};
  const internal::LabelPlanes labels{semantic.data(), instance.data(), confidence.data(),
                                     instance_confidence.data()};
  const internal::KeyRow row{keys.data(), kRow, kRanks, kRow};
  for (auto _ : state) {
    benchmark::DoNotOptimize(internal::vote_row(row, slots.data(), shade.data(), labels));
    benchmark::ClobberMemory();
  }
  state.counters["pixels_per_s"] = benchmark::Counter(
      static_cast<double>(kRow), benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(resolve_rows)->Name("stage/resolve");

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
