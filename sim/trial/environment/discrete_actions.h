#pragma once

/// @file
/// Habitat's actions for a robot with limits: each is a list of commands, one for a control
/// period, after which a robot that stood still and met nothing stands still again, exactly
/// the step farther. All of them at the robot's own pace: the fewest periods that its limits
/// allow.

#include <cstdint>
#include <span>
#include <vector>

#include "core/stages.h"
#include "sim/ground/robot.h"

namespace segsim::sim {

/// The numbers are Habitat's.
enum class DiscreteAction : std::uint8_t { kStop, kForward, kLeft, kRight };
inline constexpr int kDiscreteActions = 4;

struct DiscreteSteps {
  double forward_m = 0.25;
  double turn_rad = 0.5235987755982988;  ///< 30 degrees.
};

class DiscreteActions {
 public:
  /// @param control_period_s  Of the commands. @param substep_s  Of the robot's motion.
  DiscreteActions(const RobotModel& robot, double control_period_s, double substep_s,
                  const DiscreteSteps& steps = {});

  /// Empty for kStop.
  [[nodiscard]] std::span<const core::VelocityCommand> commands(DiscreteAction action) const;

 private:
  std::vector<core::VelocityCommand> forward_, left_, right_;
};

}  // namespace segsim::sim
