#include "sim/trial/environment/discrete_actions.h"

#include <cmath>

#include "core/check.h"
#include "core/error.h"
#include "core/formatted.h"

namespace segsim::sim {
namespace {

/// A step that takes a robot longer than that is none.
constexpr int kMostPeriods = 1000;

/// Commands of one kind, for a robot on free ground.
struct Drill {
  const RobotModel& robot;
  int substeps;
  double substep_s;
  bool turns;  ///< Left, or else straight on.

  [[nodiscard]] core::VelocityCommand command(double speed) const {
    return turns ? core::VelocityCommand{0.0, speed} : core::VelocityCommand{speed, 0.0};
  }
  [[nodiscard]] double most() const {
    return turns ? robot.max_turn_radps : robot.max_forward_mps;
  }
  /// How far it comes in one period.
  double period(Robot& base, double speed) const {
    double way = 0.0;
    base.set_command(command(speed));
    for (int k = 0; k < substeps; ++k) {
      const core::VelocityCommand velocity = base.update_velocity(substep_s);
      way += substep_s * (turns ? velocity.turn_radps : velocity.forward_mps);
    }
    return way;
  }
  /// How far it comes with that speed for so many periods until it stands again.
  /// @param all_periods  Of both.
  double way(int periods, double speed, int& all_periods) const {
    Robot base(robot, {});
    double sum = 0.0;
    for (int k = 0; k < periods; ++k) sum += period(base, speed);
    all_periods = periods;
    while (base.state().forward_mps != 0.0 || base.state().turn_radps != 0.0) {
      sum += period(base, 0.0);
      if (++all_periods > 2 * kMostPeriods) return sum;
    }
    return sum;
  }
};

std::vector<core::VelocityCommand> commands_for(const Drill& drill, double wanted) {
  int all = 0;
  for (int periods = 1; periods <= kMostPeriods; ++periods) {
    if (drill.way(periods, drill.most(), all) < wanted) continue;
    // The way grows with the speed.
    double low = 0.0, high = drill.most();
    for (int k = 0; k < 100; ++k) {
      const double middle = 0.5 * (low + high);
      (drill.way(periods, middle, all) < wanted ? low : high) = middle;
    }
    drill.way(periods, high, all);
    if (all > kMostPeriods) break;
    std::vector<core::VelocityCommand> commands(static_cast<std::size_t>(all));
    for (int k = 0; k < periods; ++k) {
      commands[static_cast<std::size_t>(k)] = drill.command(high);
    }
    return commands;
  }
  throw core::InputError::expected(drill.turns ? "turn_step_rad" : "forward_step_m",
                                   core::print("a step that %s can make in %d control periods",
                                               drill.robot.name.c_str(), kMostPeriods),
                                   core::print("%g", wanted));
}

}  // namespace

DiscreteActions::DiscreteActions(const RobotModel& robot, double control_period_s,
                                 double substep_s, const DiscreteSteps& steps) {
  SEGSIM_CHECK(steps.forward_m > 0.0 && steps.turn_rad > 0.0, "a step that goes nowhere");
  const int substeps = static_cast<int>(std::lround(control_period_s / substep_s));
  forward_ = commands_for({robot, substeps, substep_s, false}, steps.forward_m);
  left_ = commands_for({robot, substeps, substep_s, true}, steps.turn_rad);
  for (const core::VelocityCommand& command : left_)
    right_.push_back({0.0, -command.turn_radps});
}

std::span<const core::VelocityCommand> DiscreteActions::commands(DiscreteAction action) const {
  switch (action) {
    case DiscreteAction::kStop:
      return {};
    case DiscreteAction::kForward:
      return forward_;
    case DiscreteAction::kLeft:
      return left_;
    case DiscreteAction::kRight:
      return right_;
  }
  return {};
}

}  // namespace segsim::sim
