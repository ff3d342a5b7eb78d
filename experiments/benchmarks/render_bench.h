#pragma once

/// @file
/// Measures renderers on a camera path: frame times, the work counters, and how near the
/// machine's limits that is. docs/rendering.md explains the counters.

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/render.h"
#include "experiments/benchmarks/bench_scene.h"
#include "experiments/benchmarks/label_quality.h"
#include "experiments/reproducibility/machine_peaks.h"
#include "renderer/renderer_backend.h"
#include "renderer/scene/render_options.h"

namespace segsim::experiments::benchmarks {

/// What to render.
struct BenchCase {
  int width_px = 640, height_px = 480;
  core::Channels channels = core::Channels::kAll;
  renderer::RenderOptions options;
  renderer::Backend backend = renderer::Backend::kCpu;
};

/// Of all measured frames [ms], wall clock; a GPU's without the copy to the host.
struct FrameTimes {
  double median_ms = 0, p95_ms = 0, p99_ms = 0, min_ms = 0;
  int frames = 0;
};

/// Means per frame over the path.
struct MeanStats {
  double surfels_projected = 0, pairs_binned = 0, pairs_touched = 0;
  double evaluations = 0, contributions = 0, feature_fetches = 0;
};

struct BenchResult {
  BenchCase setup;
  FrameTimes times;
  MeanStats stats;
  /// Share of pixels with the panoptic id that the first case of the run gave, mean over the
  /// path; NaN without labels or if the image sizes differ.
  double agreement = 0;
  /// In labelled views, under the strict rules; none without such views.
  std::optional<reconstruction::PanopticReport> quality;

  [[nodiscard]] double fps() const { return 1000.0 / times.median_ms; }
  [[nodiscard]] double tiles() const;  ///< Of 16 x 16 px.
  [[nodiscard]] double pairs_per_tile() const { return stats.pairs_binned / tiles(); }
  /// Binned pairs per second of frame time.
  [[nodiscard]] double pairs_per_s() const { return stats.pairs_binned * fps(); }
};

[[nodiscard]] FrameTimes summarise_times(const std::vector<double>& frame_ms);

/// Share of equal pixels where at least one image is not void (0); 1 if both are all void.
/// Both images of one size.
[[nodiscard]] double label_agreement(const core::Frame& a, const core::Frame& b);

/// Renders the path `repeat` times with every case, the cases in turn at each view, so that a
/// disturbance of the machine meets all alike; one unmeasured pass comes first. Labels are
/// compared whether or not they are among the channels whose drawing is timed.
/// @param truth  Views for BenchResult::quality; may be null.
/// @param on_frame  Called after each frame with the number of frames done and of all.
[[nodiscard]] std::vector<BenchResult> run_cases(
    const BenchScene& scene, std::span<const BenchCase> cases, int repeat,
    const std::function<void(int, int)>& on_frame = {}, const LabelledViews* truth = nullptr);

/// Counted work of one frame.
struct Work {
  double flops = 0, bytes = 0;
};

/// Counters times the unit costs of render_bench.cpp, which are those of an economical
/// implementation, not of this one: the roof is meant to be out of reach.
[[nodiscard]] Work count_work(const BenchCase& setup, const MeanStats& stats);

/// The shortest possible frame for that work, and what it would be limited by.
struct Roofline {
  Work work;
  double compute_ms = 0, memory_ms = 0;
  double share = 0;  ///< max(compute_ms, memory_ms) over the median frame time.
  [[nodiscard]] const char* bound() const {
    return compute_ms >= memory_ms ? "compute" : "memory";
  }
};
[[nodiscard]] Roofline roofline(const BenchResult& result,
                                const reproducibility::MachinePeaks& peaks);

/// Words of the options, as the flags spell them.
[[nodiscard]] std::string bounds_name(renderer::TileBounds bounds);
[[nodiscard]] std::string top_k_name(int top_k);
[[nodiscard]] std::string rule_name(renderer::TopKRule rule);
/// Threads that an option of RenderOptions::threads means on this machine.
[[nodiscard]] int thread_count(int threads_option);

}  // namespace segsim::experiments::benchmarks
