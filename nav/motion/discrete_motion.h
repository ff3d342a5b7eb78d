#pragma once

/// @file
/// VLFM's actions on a robot that takes velocities: forward 0.25 m, turns of 30 degrees, stop.

#include <optional>

#include "core/frames.h"
#include "core/stages.h"

#include <glm/vec2.hpp>

namespace segsim::nav {

enum class DiscreteAction : std::uint8_t { kStop, kForward, kTurnLeft, kTurnRight };

struct DiscreteMotionOptions {
  double forward_m = 0.25;
  double turn_rad = 0.523598776;        ///< 30 degrees.
  double turn_above_rad = 0.261799388;  ///< 15 degrees off: turn, else go (SemExp's rule).
  double max_forward_mps = 0.8, max_turn_radps = 1.2;
  double forward_tolerance_m = 0.03, turn_tolerance_rad = 0.05;
  double timeout_s = 2.5;  ///< An action that is blocked counts as done then.
};

/// The action that leads towards a place: turn while it lies more than `turn_above_rad` off.
[[nodiscard]] DiscreteAction action_towards(const core::Pose2& pose, const glm::dvec2& place_m,
                                            const DiscreteMotionOptions& options);

/// Where an action ends if nothing is in the way.
[[nodiscard]] core::Pose2 after_action(const core::Pose2& pose, DiscreteAction action,
                                       const DiscreteMotionOptions& options);

/// Carries one action out over several control ticks, by what the pose says.
class DiscreteExecutor {
 public:
  explicit DiscreteExecutor(const DiscreteMotionOptions& options = {}) : options_(options) {}
  void reset() { *this = DiscreteExecutor(options_); }
  void start(DiscreteAction action, const core::Pose2& pose, core::TimeNs time_ns);
  /// Whether an action is under way. An action ends when its motion is done, or times out.
  [[nodiscard]] bool busy() const { return action_.has_value(); }
  /// The command of this tick; zero when nothing is under way (any more). `period_s` is the
  /// time until the next one.
  [[nodiscard]] core::VelocityCommand command(const core::Pose2& pose, core::TimeNs time_ns,
                                              double period_s);
  /// Whether the last action ended by its timeout.
  [[nodiscard]] bool timed_out() const { return timed_out_; }

 private:
  DiscreteMotionOptions options_;
  std::optional<DiscreteAction> action_;
  core::Pose2 from_, to_;
  core::TimeNs since_ns_ = 0;
  bool timed_out_ = false;
};

}  // namespace segsim::nav
