#include "experiments/benchmarks/render_record.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/check.h"

namespace segsim::experiments::benchmarks {
namespace {

/// Scene, size and threads; of the rest what differs from the flags' defaults.
std::string case_of(const BenchProvenance& provenance, const BenchCase& setup) {
  const int threads = thread_count(setup.options.threads);
  std::string text = provenance.scene + "; " + std::to_string(setup.width_px) + "x" +
                     std::to_string(setup.height_px) + ", ";
  text += setup.backend == renderer::Backend::kCpu
              ? std::to_string(threads) + (threads == 1 ? " thread" : " threads")
              : renderer::backend_name(setup.backend);
  const BenchCase usual;
  if (setup.channels != usual.channels) text += ", " + channels_text(setup.channels);
  if (setup.options.top_k != usual.options.top_k) {
    text += ", top-k " + top_k_name(setup.options.top_k);
  }
  if (setup.options.bounds != usual.options.bounds) {
    text += ", " + bounds_name(setup.options.bounds);
  }
  return text;
}

bool uses_gpu(std::span<const BenchResult> results) {
  return std::any_of(results.begin(), results.end(), [](const BenchResult& result) {
    return result.setup.backend != renderer::Backend::kCpu;
  });
}

}  // namespace

core::MeasurementRecord bench_record(const BenchProvenance& provenance,
                                     std::span<const BenchResult> results) {
  core::MeasurementRecord record{"Frame times of the renderer", uses_gpu(results), {}};
  for (const BenchResult& r : results) {
    const std::string name = case_of(provenance, r.setup);
    const double pixels = static_cast<double>(r.setup.width_px) * r.setup.height_px;
    for (const core::MeasuredValue& value :
         {core::MeasuredValue{name, "median", "ms", r.times.median_ms},
          core::MeasuredValue{name, "p95", "ms", r.times.p95_ms},
          core::MeasuredValue{name, "min", "ms", r.times.min_ms},
          core::MeasuredValue{name, "frames/s", "", r.fps()},
          core::MeasuredValue{name, "evaluations per pixel", "", r.stats.evaluations / pixels},
          core::MeasuredValue{name, "hits per pixel", "", r.stats.contributions / pixels}}) {
      record.values.push_back(value);
    }
  }
  return record;
}

core::MeasurementRecord ablation_record(std::span<const AblationRow> rows,
                                        std::span<const BenchResult> results) {
  SEGSIM_CHECK(rows.size() == results.size(), "a result for each row");
  core::MeasurementRecord record{"The paper's Table 2", uses_gpu(results), {}};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const AblationRow& row = rows[i];
    const BenchResult& r = results[i];
    const std::string name = row.name + " " + row.meaning;
    const auto add = [&](const char* what, const char* unit, double value) {
      record.values.push_back({name, what, unit, value});
    };
    add("time", "ms", r.times.median_ms);
    add("frames/s", "", r.fps());
    add("pairs", "M", 1e-6 * r.stats.pairs_binned);
    add("pairs per tile", "", r.pairs_per_tile());
    add("touched", "M", 1e-6 * r.stats.pairs_touched);
    add("fetches", "M", 1e-6 * r.stats.feature_fetches);
    if (!std::isnan(r.agreement)) add("agreement", "%", 100.0 * r.agreement);
    if (r.quality) {
      add("PQ", "", 100.0 * r.quality->panoptic.pq);
      add("SQ", "", 100.0 * r.quality->panoptic.sq);
      add("RQ", "", 100.0 * r.quality->panoptic.rq);
      add("mIoU", "", 100.0 * r.quality->pooled.mean_iou);
    }
    if (!row.in_paper) continue;
    add("paper: time", "ms", row.paper_ms);
    add("paper: frames/s", "", row.paper_fps);
    add("paper: pairs", "M", 1e-6 * row.paper_rn_total);
    add("paper: pairs per tile", "", row.paper_rn_tile);
    add("paper: PQ", "", row.paper_pq);
  }
  return record;
}

}  // namespace segsim::experiments::benchmarks
