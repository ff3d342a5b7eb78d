#include "experiments/runs/budget_sweep.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "experiments/benchmarks/bench_curves.h"
#include "experiments/records/store.h"

namespace segsim::experiments::runs {
namespace {

/// Success by episode and repetition.
using Outcomes = std::map<std::pair<std::string, int>, bool>;

Outcomes outcomes_of(const std::vector<records::TrialRow>& trials, const std::string& arm) {
  Outcomes outcomes;
  for (const records::TrialRow& trial : trials) {
    if (trial.arm != arm || !trial.counts()) continue;
    outcomes[{trial.scene + "\n" + trial.episode, trial.repetition}] = trial.success;
  }
  return outcomes;
}

results::PairedCounts paired(const Outcomes& before, const Outcomes& after) {
  results::PairedCounts counts;
  for (const auto& [key, first] : before) {
    const auto found = after.find(key);
    if (found == after.end()) continue;
    int& cell = first ? (found->second ? counts.both : counts.only_before)
                      : (found->second ? counts.only_after : counts.neither);
    ++cell;
  }
  return counts;
}

/// The last delay up to which `loss_of` stays within delta.
template <class Loss>
std::optional<double> margin(const std::vector<SweepPoint>& points, double delta,
                             const Loss& loss_of) {
  std::optional<double> reached;
  for (std::size_t k = 1; k < points.size(); ++k) {
    if (loss_of(points[k]) < -delta - 1e-12) break;
    reached = points[k].add_ms;
  }
  return reached;
}

}  // namespace

std::string sweep_arm(const std::string& arm, double add_ms) {
  return core::print("%s+%gms", arm.c_str(), add_ms);
}

specs::ExperimentSpec sweep_spec(const specs::ExperimentSpec& spec,
                                 const SweepOptions& options) {
  SEGSIM_CHECK(
      !options.add_ms.empty() && std::is_sorted(options.add_ms.begin(), options.add_ms.end()),
      "delays of a sweep");
  const std::string place = spec.file.string();
  const specs::ArmSpec* arm =
      options.arm.empty() ? &spec.arms.front() : spec.find_arm(options.arm);
  if (arm == nullptr) {
    throw core::InputError::expected("--arm", "an arm of " + place, options.arm);
  }
  if (spec.clock.mode != sim::ClockMode::kVirtual) {
    throw core::InputError::expected(place, "clock: {mode: virtual, budget: ...}",
                                     sim::to_string(spec.clock.mode));
  }
  if (specs::trial_clock(spec.clock, arm->clock).budget.find(options.stage) == nullptr) {
    throw core::InputError::expected("--stage", "a stage of the budget of arm " + arm->name,
                                     options.stage);
  }
  specs::ExperimentSpec swept = spec;
  swept.arms.clear();
  std::string delays;
  for (const double add_ms : options.add_ms) {
    specs::ArmSpec delayed = *arm;
    delayed.name = sweep_arm(arm->name, add_ms);
    delayed.clock.add_ms[options.stage] += add_ms;
    swept.arms.push_back(std::move(delayed));
    delays += core::print(" %g", add_ms);
  }
  // Its replay logs would name arms that the spec's text lacks.
  swept.replays.of = specs::Recorded::kNone;
  swept.sha256 =
      core::sha256_hex(spec.sha256 + "\nsweep " + options.stage + delays + " of " + arm->name);
  return swept;
}

SweepResult summarise_sweep(const SweepOptions& options, const std::string& arm,
                            const std::vector<records::TrialRow>& trials) {
  SweepResult result;
  const Outcomes base = outcomes_of(trials, sweep_arm(arm, options.add_ms.front()));
  for (const double add_ms : options.add_ms) {
    const Outcomes outcomes = outcomes_of(trials, sweep_arm(arm, add_ms));
    SweepPoint point;
    point.add_ms = add_ms;
    point.success.trials = static_cast<int>(outcomes.size());
    point.success.successes = static_cast<int>(std::count_if(
        outcomes.begin(), outcomes.end(), [](const auto& entry) { return entry.second; }));
    point.interval = results::wilson_interval(point.success);
    point.loss = results::newcombe_paired_difference(paired(base, outcomes));
    result.points.push_back(point);
  }
  result.margin_ms = margin(result.points, options.delta,
                            [](const SweepPoint& p) { return p.loss.difference; });
  result.safe_margin_ms = margin(result.points, options.delta,
                                 [](const SweepPoint& p) { return p.loss.interval.low; });
  return result;
}

std::string format_sweep(const SweepResult& result, const SweepOptions& options) {
  std::string text = core::print("%-10s %9s %16s %22s\n", "added [ms]", "success", "(95 %)",
                                 "against none (95 %)");
  for (const SweepPoint& p : result.points) {
    text += core::print("%-10g %4d/%-4d  %.3f-%.3f   %+.3f (%+.3f .. %+.3f)\n", p.add_ms,
                        p.success.successes, p.success.trials, p.interval.low, p.interval.high,
                        p.loss.difference, p.loss.interval.low, p.loss.interval.high);
  }
  const auto words = [](const std::optional<double>& ms) {
    return ms ? core::print("%g ms", *ms) : std::string("none of these delays");
  };
  text += core::print(
      "Latency margin of %s: %s (success at most %.2f lower, as measured); %s with "
      "95 %% confidence\n",
      options.stage.c_str(), words(result.margin_ms).c_str(), options.delta,
      words(result.safe_margin_ms).c_str());
  return text;
}

void write_sweep_csv(const std::filesystem::path& file, const SweepResult& result) {
  core::write_file_atomically(file, [&](std::ostream& out) {
    out << "add_ms,successes,trials,low,high,difference,difference_low,difference_high\n";
    for (const SweepPoint& p : result.points) {
      out << core::print("%g,%d,%d,%.6f,%.6f,%.6f,%.6f,%.6f\n", p.add_ms, p.success.successes,
                         p.success.trials, p.interval.low, p.interval.high, p.loss.difference,
                         p.loss.interval.low, p.loss.interval.high);
    }
  });
}

core::Image<core::Rgb8> draw_sweep(const SweepResult& result, const SweepOptions& options,
                                   const std::string& footer) {
  const auto curve = [&](const char* title, const char* y_label) {
    benchmarks::Curve made;
    made.title = title;
    made.x_label = "added to " + options.stage + " [ms]";
    made.y_label = y_label;
    return made;
  };
  benchmarks::Curve rate = curve("Success against delay", "success rate [%]");
  benchmarks::Curve low = curve("Lower end of the interval", "Wilson 95 %, lower [%]");
  for (const SweepPoint& p : result.points) {
    for (benchmarks::Curve* c : {&rate, &low}) c->x.push_back(p.add_ms);
    rate.y.push_back(100.0 * p.success.value());
    low.y.push_back(100.0 * p.interval.low);
  }
  rate.note = result.margin_ms
                  ? core::print("latency margin %g ms (at most %.0f points lower)",
                                *result.margin_ms, 100.0 * options.delta)
                  : core::print("no delay within %.0f points", 100.0 * options.delta);
  const auto [fewest, most] =
      std::minmax_element(result.points.begin(), result.points.end(),
                          [](const SweepPoint& x, const SweepPoint& y) {
                            return x.success.trials < y.success.trials;
                          });
  low.note =
      fewest->success.trials == most->success.trials
          ? core::print("%d trials per delay, of the same episodes", most->success.trials)
          : core::print("INTERIM: %d to %d trials per delay", fewest->success.trials,
                        most->success.trials);
  return benchmarks::draw_curves({rate, low}, footer);
}

}  // namespace segsim::experiments::runs
