#pragma once

/// @file
/// The commands that are on their way from the policy to the wheels, and the budget's rules
/// for those that come late or rest on an old image.

#include <cstdint>
#include <map>
#include <optional>

#include "core/stages.h"
#include "sim/time/latency_budget.h"
#include "sim/time/timing.h"

namespace segsim::sim::internal {

/// What the base is told.
struct BaseOrder {
  enum class Kind : std::uint8_t {
    kNothing,
    kDrive,      ///< From now on with `command`.
    kSendAgain,  ///< The command in effect holds on.
    kStop,       ///< The policy's STOP: the trial ends.
    kAbort,      ///< The budget ends the trial.
  };
  Kind kind = Kind::kNothing;
  core::VelocityCommand command;
  std::optional<core::StopReason> stop;  ///< Of kStop.
};

class CommandQueue {
 public:
  /// @param budget  Its rules for deadlines and ages. Empty: every command takes effect.
  explicit CommandQueue(const LatencyBudget& budget);

  /// Whether the budget throws away what an image of that age would lead to, before anything
  /// is decided on it. Counted as a miss; the command in effect is not sent again.
  [[nodiscard]] bool refuses(core::TimeNs image_age_ns);
  /// The policy decided at that tick, on the image of that time.
  void send(std::uint64_t tick, const core::Decision& decision, core::TimeNs capture_ns,
            core::TimeNs now_ns);
  /// The command of that tick reaches the wheels.
  [[nodiscard]] BaseOrder arrive(std::uint64_t tick, core::TimeNs time_ns);
  /// At every tick: the image in use is that old.
  [[nodiscard]] BaseOrder check_age(core::TimeNs age_ns);
  /// At a tick without a decision.
  [[nodiscard]] BaseOrder repeat() const;

  [[nodiscard]] bool on_its_way(std::uint64_t tick) const { return sent_.contains(tick); }
  /// From each image to its command at the wheels.
  [[nodiscard]] const StageTiming& end_to_end() const { return end_to_end_; }

 private:
  struct Sent {
    core::VelocityCommand command;
    core::TimeNs capture_ns = 0;
    std::optional<core::StopReason> stop;
    bool too_old = false;  ///< Its image exceeded the largest age.
  };
  /// The age matters, and it is too large.
  [[nodiscard]] bool too_old(core::TimeNs age_ns) const;

  OnMiss on_miss_, on_max_age_;
  core::TimeNs max_age_ns_;
  StageTiming end_to_end_;
  std::map<std::uint64_t, Sent> sent_;  ///< By tick.
  std::uint64_t newest_arrived_ = 0;
  bool sends_again_ = true;
};

}  // namespace segsim::sim::internal
