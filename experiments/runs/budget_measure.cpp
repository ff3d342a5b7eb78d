#include "experiments/runs/budget_measure.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "sim/time/stage_role.h"

namespace segsim::experiments::runs {
namespace {

/// @param values  Sorted, not empty. @param share  [0, 1]: of the values that are smaller.
core::TimeNs quantile(const std::vector<core::TimeNs>& values, double share) {
  return values[static_cast<std::size_t>(
      std::lround(share * static_cast<double>(values.size() - 1)))];
}

}  // namespace

specs::ExperimentSpec measured_spec(const specs::ExperimentSpec& spec,
                                    const std::string& arm) {
  const specs::ArmSpec* found = arm.empty() ? &spec.arms.front() : spec.find_arm(arm);
  if (found == nullptr) {
    throw core::InputError::expected("--arm", "an arm of " + spec.file.string(), arm);
  }
  specs::ExperimentSpec measured = spec;
  measured.arms = {*found};
  measured.arms.front().name += ".measured";  // Its rows are none of the run.
  measured.arms.front().clock = {};
  measured.clock = {};
  measured.clock.mode = sim::ClockMode::kMeasured;
  measured.repetitions = {};
  measured.replays = {specs::Recorded::kAll, false};
  measured.frames.of = specs::Recorded::kNone;
  measured.videos = specs::Recorded::kNone;
  measured.pictures = false;
  measured.sha256 = core::sha256_hex(spec.sha256 + "\nmeasured " + found->name);
  return measured;
}

void add_durations(const sim::LatencyTrace& trace, StageDurations& durations) {
  for (const auto& [stage, entries] : trace.stages()) {
    for (const auto& [index, duration_ns] : entries) durations[stage].push_back(duration_ns);
  }
}

std::string budget_text(const MeasuredBudget& about, const StageDurations& durations) {
  if (durations.empty()) {
    throw core::InputError::expected("budget measure", "trials that took time", "none");
  }
  std::string text = "# " + about.origin + "\n";
  std::string stages;
  for (const auto& [stage, unsorted] : durations) {
    std::vector<core::TimeNs> values = unsorted;
    std::sort(values.begin(), values.end());
    const double p50_ms = sim::ms_from_ns(quantile(values, 0.50));
    const double p95_ms = sim::ms_from_ns(quantile(values, 0.95));
    text +=
        core::print("# %s: %zu times, median %.3f, p95 %.3f, p99 %.3f, longest %.3f ms\n",
                    stage.c_str(), values.size(), p50_ms, p95_ms,
                    sim::ms_from_ns(quantile(values, 0.99)), sim::ms_from_ns(values.back()));
    const bool on_gpu =
        about.detects_on_gpu && sim::stage_role(stage) == sim::StageRole::kDetect;
    stages += "  " + stage + ": {on: " + (on_gpu ? "gpu" : "cpu");
    stages +=
        p95_ms - p50_ms < 1e-3
            ? core::print(", ms: %.3f}\n", p50_ms)
            : core::print(", dist: {lognormal: {p50: %.3f, p95: %.3f}}}\n", p50_ms, p95_ms);
  }
  text += "schema: " + std::string(specs::kBudgetSchema) + "\nid: " + about.id + "\n";
  text += core::print("resources: {cpu: %d%s}\n", about.processors,
                      about.detects_on_gpu ? ", gpu: 1" : "");
  return text + "stages:\n  capture: {ms: 0}\n" + stages + "  actuate: {ms: 0}\n";
}

}  // namespace segsim::experiments::runs
