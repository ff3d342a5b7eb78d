// Text, JSON and CSV forms of benchmark results.
#include "experiments/benchmarks/render_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <nlohmann/json.hpp>

#include "core/check.h"
#include "core/formatted.h"
#include "core/process/measurement_record.h"
#include "core/version.h"
#include "experiments/records/store.h"
#include "experiments/support/text_grid.h"
#include "renderer/scene/simd_target.h"

namespace segsim::experiments::benchmarks {
namespace {

using Json = nlohmann::ordered_json;

std::string size_text(const BenchCase& setup) {
  return std::to_string(setup.width_px) + "x" + std::to_string(setup.height_px);
}

/// Names and values of one result, in the order of the CSV's columns.
std::vector<std::pair<std::string, Json>> fields_of(const BenchProvenance& provenance,
                                                    const BenchResult& result) {
  const BenchCase& setup = result.setup;
  const int threads = thread_count(setup.options.threads);
  const Roofline roof = roofline(result, provenance.peaks_for(threads));
  return {{"width_px", setup.width_px},
          {"height_px", setup.height_px},
          {"channels", channels_text(setup.channels)},
          {"top_k", top_k_name(setup.options.top_k)},
          {"top_k_rule", rule_name(setup.options.top_k_rule)},
          {"bounds", bounds_name(setup.options.bounds)},
          {"backend", renderer::backend_name(setup.backend)},
          {"threads", threads},
          {"frames", result.times.frames},
          {"median_ms", result.times.median_ms},
          {"p95_ms", result.times.p95_ms},
          {"p99_ms", result.times.p99_ms},
          {"min_ms", result.times.min_ms},
          {"fps", result.fps()},
          {"surfels_projected", result.stats.surfels_projected},
          {"pairs_binned", result.stats.pairs_binned},
          {"pairs_touched", result.stats.pairs_touched},
          {"evaluations", result.stats.evaluations},
          {"contributions", result.stats.contributions},
          {"feature_fetches", result.stats.feature_fetches},
          {"pairs_per_tile", result.pairs_per_tile()},
          {"pairs_per_s", result.pairs_per_s()},
          {"roofline_flops", roof.work.flops},
          {"roofline_bytes", roof.work.bytes},
          {"roofline_compute_ms", roof.compute_ms},
          {"roofline_memory_ms", roof.memory_ms},
          {"roofline_bound", roof.bound()},
          {"roofline_share", roof.share}};
}

}  // namespace

std::string channels_text(core::Channels channels) {
  std::string text;
  const auto add = [&](core::Channels channel, const char* word) {
    if (core::has(channels, channel)) text += (text.empty() ? "" : "+") + std::string(word);
  };
  add(core::Channels::kRgb, "rgb");
  add(core::Channels::kDepth, "depth");
  add(core::Channels::kNormal, "normal");
  add(core::Channels::kLabels, "labels");
  add(core::Channels::kDepthNormal, "depth-normal");
  add(core::Channels::kFeatures, "features");
  return text;
}

const reproducibility::MachinePeaks& BenchProvenance::peaks_for(int threads) const {
  const auto found = std::find_if(
      peaks.begin(), peaks.end(),
      [&](const reproducibility::MachinePeaks& p) { return p.threads == threads; });
  SEGSIM_CHECK(found != peaks.end(), "no peaks for " + std::to_string(threads) + " threads");
  return *found;
}

BenchProvenance bench_provenance(const BenchScene& scene, std::span<const BenchCase> cases,
                                 int repeat) {
  BenchProvenance provenance{core::version(),
                             core::processor_name(),
                             renderer::simd_target(),
                             records::utc_now(),
                             scene.name,
                             static_cast<int>(scene.path.size()),
                             repeat,
                             {}};
  std::vector<int> threads{1};
  for (const BenchCase& setup : cases) threads.push_back(thread_count(setup.options.threads));
  std::sort(threads.begin(), threads.end());
  threads.erase(std::unique(threads.begin(), threads.end()), threads.end());
  for (const int count : threads)
    provenance.peaks.push_back(reproducibility::measure_machine_peaks(count));
  return provenance;
}

std::string bench_text(const BenchProvenance& provenance,
                       std::span<const BenchResult> results) {
  support::internal::TextGrid grid;
  grid.header = {"Image",   "Top-K",    "Bounds",  "Threads",    "Median [ms]", "p95",
                 "p99",     "Min",      "FPS",     "Surfels",    "Pairs",       "Pairs/tile",
                 "Touched", "Evals/px", "Hits/px", "Fetches/px", "Pairs/s"};
  for (const BenchResult& r : results) {
    const double pixels = static_cast<double>(r.setup.width_px) * r.setup.height_px;
    grid.rows.push_back(
        {size_text(r.setup), top_k_name(r.setup.options.top_k),
         bounds_name(r.setup.options.bounds),
         r.setup.backend == renderer::Backend::kCpu
             ? std::to_string(thread_count(r.setup.options.threads))
             : renderer::backend_name(r.setup.backend),
         core::print("%.2f", r.times.median_ms), core::print("%.2f", r.times.p95_ms),
         core::print("%.2f", r.times.p99_ms), core::print("%.2f", r.times.min_ms),
         core::print("%.1f", r.fps()), support::internal::amount(r.stats.surfels_projected),
         support::internal::amount(r.stats.pairs_binned),
         core::print("%.0f", r.pairs_per_tile()),
         support::internal::amount(r.stats.pairs_touched),
         core::print("%.1f", r.stats.evaluations / pixels),
         core::print("%.1f", r.stats.contributions / pixels),
         core::print("%.1f", r.stats.feature_fetches / pixels),
         support::internal::amount(r.pairs_per_s())});
  }
  std::string text = provenance.scene + "; " + std::to_string(provenance.views) + " views x " +
                     std::to_string(provenance.repeat) + "\n\n" +
                     support::internal::text_of(grid) + "\n";
  for (const BenchResult& r : results) {
    if (r.setup.backend != renderer::Backend::kCpu)
      continue;  // The peaks are the processor's.
    const int threads = thread_count(r.setup.options.threads);
    const Roofline roof = roofline(r, provenance.peaks_for(threads));
    char line[256];
    std::snprintf(line, sizeof line,
                  "roofline %s, top-k %s, %s, %d thread%s: %.2f GFLOP -> %.2f ms, %.0f MB -> "
                  "%.2f ms; %.0f %% of the %s limit\n",
                  size_text(r.setup).c_str(), top_k_name(r.setup.options.top_k).c_str(),
                  bounds_name(r.setup.options.bounds).c_str(), threads,
                  threads == 1 ? "" : "s", 1e-9 * roof.work.flops, roof.compute_ms,
                  1e-6 * roof.work.bytes, roof.memory_ms, 100.0 * roof.share, roof.bound());
    text += line;
  }
  for (const reproducibility::MachinePeaks& peaks : provenance.peaks) {
    text += "peak, " + std::to_string(peaks.threads) +
            (peaks.threads == 1 ? " thread: " : " threads: ") +
            core::print("%.0f GFLOP/s (", peaks.gflops) + peaks.vector_isa +
            core::print("), read %.1f GB/s\n", peaks.read_gbps);
  }
  return text + "segsim " + provenance.version + ", " + provenance.cpu + ", SIMD " +
         provenance.simd + ", " + provenance.date + "\n";
}

std::string bench_json(const BenchProvenance& provenance,
                       std::span<const BenchResult> results) {
  Json json;
  json["schema"] = "segsim.bench.render/1";
  json["scene"] = provenance.scene;
  json["views"] = provenance.views;
  json["repeat"] = provenance.repeat;
  json["provenance"] = {{"version", provenance.version},
                        {"cpu", provenance.cpu},
                        {"simd", provenance.simd},
                        {"date", provenance.date}};
  for (const reproducibility::MachinePeaks& peaks : provenance.peaks) {
    json["provenance"]["peaks"].push_back({{"threads", peaks.threads},
                                           {"isa", peaks.vector_isa},
                                           {"gflops", peaks.gflops},
                                           {"read_gbps", peaks.read_gbps}});
  }
  json["results"] = Json::array();
  for (const BenchResult& result : results) {
    Json entry;
    for (const auto& [name, value] : fields_of(provenance, result)) entry[name] = value;
    json["results"].push_back(std::move(entry));
  }
  return json.dump(2) + "\n";
}

std::string bench_csv(const BenchProvenance& provenance,
                      std::span<const BenchResult> results) {
  std::string text;
  for (const BenchResult& result : results) {
    std::string header, line;
    for (const auto& [name, value] : fields_of(provenance, result)) {
      header += (header.empty() ? "" : ",") + name;
      line += (line.empty() ? "" : ",") +
              (value.is_string() ? value.get<std::string>() : value.dump());
    }
    if (text.empty()) text = header + "\n";
    text += line + "\n";
  }
  return text;
}

}  // namespace segsim::experiments::benchmarks
