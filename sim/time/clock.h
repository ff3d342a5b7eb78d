#pragma once

/// @file
/// Simulated time: int64 nanoseconds, and where the time that a stage takes comes from.
///
/// | mode     | durations                                        | repeatable          |
/// |----------|--------------------------------------------------|---------------------|
/// | lockstep | zero: the world waits                            | yes                 |
/// | virtual  | the budget: constants, distributions, a trace    | yes, from the seed  |
/// | measured | this machine's, times a factor; kept as a trace  | by playing the trace|
/// | realtime | this machine's; simulated time follows the clock | no                  |

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "core/stages.h"
#include "sim/time/latency_budget.h"

namespace segsim::sim {

enum class ClockMode : std::uint8_t { kLockstep, kVirtual, kMeasured, kRealtime };
[[nodiscard]] const char* to_string(ClockMode mode);

/// When a sensor samples: index i at phase + i * period, shaken by up to +-jitter.
struct SensorRate {
  core::TimeNs period_ns = 0;  ///< 0: the control period.
  core::TimeNs phase_ns = 0;
  core::TimeNs jitter_ns = 0;  ///< Less than half the period, so that the order stays.

  /// Never before 0. The jitter is keyed by the episode's seed and the index.
  [[nodiscard]] core::TimeNs time_of(std::uint64_t index, std::uint64_t episode_seed) const;
};

/// Which pose estimate a result is placed with. kUse is a common mistake on robots: labels
/// shift by 2 r sin(w age / 2) when the robot turns.
enum class Registration : std::uint8_t { kCapture, kUse };

/// How time passes in a trial.
struct TrialClock {
  ClockMode mode = ClockMode::kLockstep;
  LatencyBudget budget;  ///< Not used in lockstep.
  SensorRate camera;
  Registration registration = Registration::kCapture;
  /// kMeasured, kRealtime: by how much the robot's computer is slower than this one.
  double measured_scale = 1.0;

  /// The budget that is played: empty in lockstep; with the measured stages (kDetect,
  /// kPolicy, and kRender if charged to the robot) in measured and realtime mode.
  [[nodiscard]] LatencyBudget played_budget() const;
  [[nodiscard]] bool measures() const {
    return mode == ClockMode::kMeasured || mode == ClockMode::kRealtime;
  }
};

/// Holds simulated time back to the wall clock.
class Pacer {
 public:
  using Now = std::function<core::TimeNs()>;
  using SleepUntil = std::function<void(core::TimeNs)>;
  /// The steady clock of this machine.
  Pacer();
  Pacer(Now now, SleepUntil sleep_until);

  /// Waits until the wall clock has come as far as simulated time, counted from the first
  /// call. @return  How late it was already [ns]; 0 if it waited.
  core::TimeNs wait_until(core::TimeNs simulated_ns);

 private:
  Now now_;
  SleepUntil sleep_until_;
  std::optional<core::TimeNs> start_ns_;
};

}  // namespace segsim::sim
