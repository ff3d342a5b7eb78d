#include "experiments/benchmarks/render_bench.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <thread>

#include "core/check.h"
#include "core/quantile.h"
#include "experiments/reproducibility/backend_warning.h"

namespace segsim::experiments::benchmarks {
namespace {

using core::Channels;
using core::has;

constexpr int kTile_px = 16;

// Unit costs. Flops: a fused multiply-add is two; exp2 is its polynomial. Bytes: what has to
// come from or go to memory at least once.
constexpr double kProjectFlops = 250.0,
                 kProjectBytes = 32.0 + 64.0;  // Geometry in, record out.
constexpr double kPairBytes = 2.0 * 8.0;       // A key and index, written and read.
constexpr double kTouchBytes = 64.0;           // The record of the surfel.
constexpr double kEvaluationFlops = 18.0;      // q, e and the hit test.
constexpr double kContributionFlops = 26.0;    // rho, exp2, alpha, T, colour, depth, normal.
constexpr double kLabelRowBytes = 4.0;         // Class and instance.
constexpr double kFeatureRow = core::kSemanticFeatureSize + core::kInstanceFeatureSize;

double bytes_per_pixel(Channels channels) {
  double bytes = 4.0;  // Alpha.
  if (has(channels, Channels::kRgb)) bytes += 3.0;
  if (has(channels, Channels::kDepth)) bytes += 4.0;
  if (has(channels, Channels::kNormal)) bytes += 12.0;
  if (has(channels, Channels::kLabels)) bytes += 2.0 + 2.0 + 4.0 + 4.0;
  if (has(channels, Channels::kDepthNormal)) bytes += 12.0;
  if (has(channels, Channels::kFeatures)) bytes += 4.0 * kFeatureRow;
  return bytes;
}

void add(const core::RenderStats& stats, double factor, MeanStats& sum) {
  sum.surfels_projected += factor * static_cast<double>(stats.surfels_projected);
  sum.pairs_binned += factor * static_cast<double>(stats.pairs_binned);
  sum.pairs_touched += factor * static_cast<double>(stats.pairs_touched);
  sum.evaluations += factor * static_cast<double>(stats.evaluations);
  sum.contributions += factor * static_cast<double>(stats.contributions);
  sum.feature_fetches += factor * static_cast<double>(stats.feature_fetches);
}

/// NaN where the two cannot be compared.
double agreement_with(const core::Frame& first, const core::Frame& frame) {
  if (first.semantic.empty() || frame.semantic.size() != first.semantic.size() ||
      frame.semantic.width_px() != first.semantic.width_px()) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  return label_agreement(first, frame);
}

}  // namespace

double BenchResult::tiles() const {
  const auto along = [](int px) { return (px + kTile_px - 1) / kTile_px; };
  return static_cast<double>(along(setup.width_px)) * along(setup.height_px);
}

FrameTimes summarise_times(const std::vector<double>& frame_ms) {
  return {core::interpolated_quantile(frame_ms, 0.5),
          core::interpolated_quantile(frame_ms, 0.95),
          core::interpolated_quantile(frame_ms, 0.99),
          core::interpolated_quantile(frame_ms, 0.0), static_cast<int>(frame_ms.size())};
}

double label_agreement(const core::Frame& a, const core::Frame& b) {
  SEGSIM_CHECK(a.semantic.size() == b.semantic.size(), "label images of different sizes");
  std::size_t equal = 0, labelled = 0;
  for (std::size_t i = 0; i < a.semantic.size(); ++i) {
    const std::uint32_t x = core::panoptic_id(a.semantic.pixels()[i], a.instance.pixels()[i]);
    const std::uint32_t y = core::panoptic_id(b.semantic.pixels()[i], b.instance.pixels()[i]);
    if (x == 0 && y == 0) continue;
    ++labelled;
    equal += x == y ? 1 : 0;
  }
  return labelled == 0 ? 1.0 : static_cast<double>(equal) / static_cast<double>(labelled);
}

std::vector<BenchResult> run_cases(const BenchScene& scene, std::span<const BenchCase> cases,
                                   int repeat, const std::function<void(int, int)>& on_frame,
                                   const LabelledViews* truth) {
  SEGSIM_CHECK(repeat > 0, "repeat = " + std::to_string(repeat));
  std::vector<BenchResult> results(cases.size());
  std::vector<std::unique_ptr<core::Renderer>> renderers;
  std::vector<core::Frame> frames(cases.size()), labels(cases.size());
  std::vector<std::vector<double>> frame_ms(cases.size());
  for (std::size_t c = 0; c < cases.size(); ++c) {
    results[c].setup = cases[c];
    renderers.push_back(renderer::make_renderer(cases[c].backend, scene.surfels,
                                                cases[c].options, scene.labels,
                                                reproducibility::warn_about_backend));
  }
  const int total = static_cast<int>(scene.path.size() * cases.size()) * (repeat + 1);
  const double share = 1.0 / static_cast<double>(scene.path.size());
  const bool labelled = scene.labels != nullptr || scene.surfels->has_labels();
  int done = 0;
  for (int pass = 0; pass <= repeat; ++pass) {  // Pass 0 allocates, counts and compares.
    for (const core::CameraPose& T_world_camera : scene.path) {
      for (std::size_t c = 0; c < cases.size(); ++c) {
        const BenchCase& setup = cases[c];
        const core::CameraIntrinsics camera = scene.camera(setup.width_px, setup.height_px);
        if (pass == 0) {
          renderers[c]->render(T_world_camera, camera, setup.channels, frames[c]);
          add(frames[c].stats, share, results[c].stats);
          if (labelled) {
            renderers[c]->render(T_world_camera, camera, Channels::kLabels, labels[c]);
          }
          results[c].agreement += share * agreement_with(labels[0], labels[c]);
        } else {
          const auto start = std::chrono::steady_clock::now();
          renderer::draw_in_place(*renderers[c], T_world_camera, camera, setup.channels,
                                  frames[c]);
          const std::chrono::duration<double, std::milli> wall =
              std::chrono::steady_clock::now() - start;
          frame_ms[c].push_back(wall.count());
        }
        if (on_frame) on_frame(++done, total);
      }
    }
  }
  for (std::size_t c = 0; c < cases.size(); ++c) {
    results[c].times = summarise_times(frame_ms[c]);
    if (truth != nullptr) results[c].quality = label_quality(*renderers[c], *truth);
  }
  return results;
}

Work count_work(const BenchCase& setup, const MeanStats& stats) {
  const bool features = has(setup.channels, Channels::kFeatures);
  Work work;
  work.flops = kProjectFlops * stats.surfels_projected + kEvaluationFlops * stats.evaluations +
               kContributionFlops * stats.contributions +
               (features ? 2.0 * kFeatureRow * stats.feature_fetches : 0.0);
  work.bytes = kProjectBytes * stats.surfels_projected + kPairBytes * stats.pairs_binned +
               kTouchBytes * stats.pairs_touched +
               (features ? 4.0 * kFeatureRow : kLabelRowBytes) * stats.feature_fetches +
               bytes_per_pixel(setup.channels) * setup.width_px * setup.height_px;
  return work;
}

Roofline roofline(const BenchResult& result, const reproducibility::MachinePeaks& peaks) {
  Roofline roof;
  roof.work = count_work(result.setup, result.stats);
  roof.compute_ms = roof.work.flops / (1e6 * peaks.gflops);
  roof.memory_ms = roof.work.bytes / (1e6 * peaks.read_gbps);
  roof.share = std::max(roof.compute_ms, roof.memory_ms) / result.times.median_ms;
  return roof;
}

std::string bounds_name(renderer::TileBounds bounds) {
  switch (bounds) {
    case renderer::TileBounds::kAabb:
      return "aabb";
    case renderer::TileBounds::kSnugBox:
      return "snugbox";
    case renderer::TileBounds::kAccuTile:
      return "accutile";
    case renderer::TileBounds::kPaper:
      return "paper";
  }
  return "?";
}

std::string top_k_name(int top_k) {
  return top_k == renderer::kAllSurfels ? "all" : std::to_string(top_k);
}

std::string rule_name(renderer::TopKRule rule) {
  return rule == renderer::TopKRule::kFirst ? "first" : "heaviest";
}

int thread_count(int threads_option) {
  if (threads_option > 0) return threads_option;
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

}  // namespace segsim::experiments::benchmarks
