#pragma once

/// @file
/// Success rate against added delay: how much later may a stage be before the robot fails?

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "experiments/results/statistics.h"
#include "experiments/runs/run.h"

namespace segsim::experiments::runs {

struct SweepOptions {
  std::string stage = "detect";
  std::vector<double> add_ms;  ///< Ascending, the first is what the others are compared with.
  std::string arm;             ///< Empty: the spec's first.
  double delta = 0.10;         ///< Loss of success rate that is still accepted.
};

struct SweepPoint {
  double add_ms = 0.0;
  results::Proportion success;
  results::Interval interval;  ///< Wilson's.
  results::PairedDifference
      loss;  ///< Success here - success without delay, on the same episodes.
};

struct SweepResult {
  std::vector<SweepPoint> points;
  /// The largest delay up to which no success rate is worse by more than delta; none if the
  /// second point already is. As measured, and with the interval's lower end.
  std::optional<double> margin_ms, safe_margin_ms;
};

/// The spec with one arm per delay, named <arm>+<ms>ms. @throws core::InputError if the arm's
/// budget has no such stage or the clock is not virtual.
[[nodiscard]] specs::ExperimentSpec sweep_spec(const specs::ExperimentSpec& spec,
                                               const SweepOptions& options);

/// From the trials of such a spec. Pairs with a failed harness are left out.
[[nodiscard]] SweepResult summarise_sweep(const SweepOptions& options, const std::string& arm,
                                          const std::vector<records::TrialRow>& trials);
/// Name of the arm with a delay.
[[nodiscard]] std::string sweep_arm(const std::string& arm, double add_ms);

[[nodiscard]] std::string format_sweep(const SweepResult& result, const SweepOptions& options);
void write_sweep_csv(const std::filesystem::path& file, const SweepResult& result);
/// Success rate and the lower end of its interval against delay. @param footer  One line
/// below.
[[nodiscard]] core::Image<core::Rgb8> draw_sweep(const SweepResult& result,
                                                 const SweepOptions& options,
                                                 const std::string& footer);

}  // namespace segsim::experiments::runs
