/// @file
/// Frames per second in a furnished room of opaque surfels, from a camera that turns in its
/// middle; and the stages of a frame by themselves, on one thread.

#include <benchmark/benchmark.h>

#include <array>
#include <bit>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "core/frames.h"
#include "renderer/cpu_renderer.h"
#include "renderer/internal/label_vote.h"
#include "renderer/internal/projection_camera.h"
#include "renderer/internal/tile_raster.h"
#include "renderer/internal/tile_state.h"
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

/// A view's data between the stages.
struct Stages {
  core::CameraIntrinsics camera = core::CameraIntrinsics::from_fov(640, 480, 1.2);
  core::CameraPose pose = turning_camera(3);
  internal::PackedSurfels packed{*room()};
  internal::Workers workers{1};
  internal::ProjectedSurfels projected;
  internal::TileBins bins;
  core::Frame frame;

  void project() {
    const internal::ProjectionJob job{*room(),
                                      packed,
                                      internal::projection_camera<float>(pose, camera),
                                      camera.width_px,
                                      camera.height_px,
                                      0.05F,
                                      true};
    internal::find_visible_clusters(job, projected);
    internal::project_clusters(job, 0, projected.visible.size(), workers, projected);
  }
  void bin() {
    bins.begin(camera.width_px, camera.height_px);
    bins.add_slab(projected, 0, projected.visible.size(),
                  std::numeric_limits<float>::infinity(), workers);
  }
};

void project_view(benchmark::State& state) {
  Stages stages;
  for (auto _ : state) stages.project();
  std::size_t drawn = 0;
  for (std::size_t v = 0; v < stages.projected.visible.size(); ++v) {
    drawn += stages.projected.count[v];
  }
  state.counters["surfels_per_s"] = benchmark::Counter(
      static_cast<double>(drawn), benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(project_view)->Name("stage/project")->Unit(benchmark::kMillisecond);

void bin_view(benchmark::State& state) {
  Stages stages;
  stages.project();
  for (auto _ : state) stages.bin();
  state.counters["pairs_per_s"] =
      benchmark::Counter(static_cast<double>(stages.bins.pair_count()),
                         benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(bin_view)->Name("stage/bin")->Unit(benchmark::kMillisecond);

/// All tiles of a view, with the writing of their pixels.
void raster_view(benchmark::State& state) {
  Stages stages;
  stages.project();
  stages.bin();
  stages.frame.intrinsics = stages.camera;
  const int w = stages.camera.width_px, h = stages.camera.height_px;
  stages.frame.alpha.resize(w, h);
  stages.frame.rgb.resize(w, h);
  stages.frame.depth_m.resize(w, h);
  stages.frame.normal.resize(w, h);
  const internal::ResolveJob resolve;
  const internal::RasterJob job{.projected = stages.projected,
                                .bins = stages.bins,
                                .frame = stages.frame,
                                .channels = Channels::kRgbd | Channels::kNormal,
                                .top_k = 4,
                                .median_depth = true,
                                .labelled = false,
                                .resolve = &resolve};
  std::vector<internal::TileProgress> progress(stages.bins.tile_count());
  std::uint64_t evaluations = 0;
  for (auto _ : state) {
    evaluations = 0;
    for (std::size_t tile = 0; tile < progress.size(); ++tile) {
      progress[tile].started = false;
      evaluations += internal::raster_tile(job, tile, true, progress[tile]).evaluations;
    }
  }
  state.counters["evaluations_per_s"] = benchmark::Counter(
      static_cast<double>(evaluations), benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(raster_view)->Name("stage/raster")->Unit(benchmark::kMillisecond);

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
          (std::bit_cast<std::uint32_t>(weight) & ~internal::kKeyPositionMask) |
          static_cast<std::uint32_t>(random.index(kSlots));
    }
  }
  std::array<internal::PixelLabel, kRow> labels;
  const internal::KeyRow row{keys.data(), kRow, kRanks, kRow};
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        internal::vote_row(row, slots.data(), shade.data(), labels.data()));
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
