#pragma once

/// @file
/// The robot's computer in a trial: plays the latency budget, runs what the program itself
/// does for a stage, and keeps what each job took.

#include <cstdint>
#include <vector>

#include "sim/time/schedule.h"
#include "sim/trial/internal/trial_eye.h"

namespace segsim::sim::internal {

class RobotComputer {
 public:
  /// @param eye  Whose images it works on; outlives it, as the options do.
  RobotComputer(const TrialOptions& options, std::uint64_t episode_seed, TrialEye& eye);
  RobotComputer(const RobotComputer&) = delete;
  RobotComputer& operator=(const RobotComputer&) = delete;

  /// Begins to work on an image that is taken now.
  void take_in(const Capture& capture) { schedule_.capture(capture.time_ns, capture.index); }
  /// The policy has decided at that tick: in simulated time its work begins.
  /// @param measured_ns  What that took on this machine.
  void decided(core::TimeNs now_ns, std::uint64_t tick, core::TimeNs measured_ns);
  /// Whether the policy is still at the work of an earlier tick.
  [[nodiscard]] bool deciding() const { return schedule_.deciding(); }

  /// Computes up to and including that time; the eye learns which images are ready.
  /// @return  The commands that reach the wheels meanwhile, in order of time.
  [[nodiscard]] std::vector<Schedule::Effect> compute_until(core::TimeNs time_ns);

  [[nodiscard]] const LatencyBudget& budget() const { return budget_; }
  /// All durations so far.
  [[nodiscard]] const LatencyTrace& trace() const { return trace_; }
  void report(TimingReport& report) const { schedule_.report(report); }

 private:
  /// Duration of one job that starts now; runs what this program does for it.
  [[nodiscard]] core::TimeNs work(const StageBudget& stage, std::uint64_t index);

  const TrialOptions& options_;
  std::uint64_t seed_;
  TrialEye& eye_;
  LatencyBudget budget_;
  LatencyTrace trace_;
  core::TimeNs policy_ns_ = 0;  ///< Wall time of the newest decision.
  Schedule schedule_;
};

}  // namespace segsim::sim::internal
