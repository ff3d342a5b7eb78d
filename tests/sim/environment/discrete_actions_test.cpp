#include "sim/trial/environment/discrete_actions.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

namespace segsim::sim {
namespace {

constexpr double kPeriod_s = 0.1, kSubstep_s = 0.005;

/// Where a robot stands after the commands, on free ground.
RobotState after(const RobotModel& model, std::span<const core::VelocityCommand> commands,
                 double period_s = kPeriod_s) {
  Robot robot(model, {});
  for (const core::VelocityCommand& command : commands) {
    robot.set_command(command);
    for (int k = 0; k < std::lround(period_s / kSubstep_s); ++k) robot.step(kSubstep_s);
  }
  return robot.state();
}

class DiscreteActionsTest : public testing::TestWithParam<std::string> {};

TEST_P(DiscreteActionsTest, EveryRobotComesAsFarAsTheStepAndStands) {
  const RobotModel robot = RobotModel::by_name(GetParam());
  const DiscreteActions actions(robot, kPeriod_s, kSubstep_s);
  const RobotState ahead = after(robot, actions.commands(DiscreteAction::kForward));
  EXPECT_NEAR(ahead.pose.x_m, 0.25, 1e-9);
  EXPECT_EQ(ahead.pose.y_m, 0.0);
  EXPECT_EQ(ahead.forward_mps, 0.0);
  const RobotState left = after(robot, actions.commands(DiscreteAction::kLeft));
  EXPECT_NEAR(left.pose.yaw_rad, std::numbers::pi / 6.0, 1e-9);
  EXPECT_EQ(left.pose.x_m, 0.0);
  EXPECT_EQ(left.turn_radps, 0.0);
  const RobotState right = after(robot, actions.commands(DiscreteAction::kRight));
  EXPECT_EQ(right.pose.yaw_rad, -left.pose.yaw_rad);
  EXPECT_TRUE(actions.commands(DiscreteAction::kStop).empty());
}

TEST_P(DiscreteActionsTest, NoPeriodLessWouldDo) {
  const RobotModel robot = RobotModel::by_name(GetParam());
  const DiscreteActions actions(robot, kPeriod_s, kSubstep_s);
  const auto commands = actions.commands(DiscreteAction::kForward);
  std::vector<core::VelocityCommand> fewer;
  for (const core::VelocityCommand& command : commands) {
    if (command.forward_mps > 0.0) fewer.push_back({robot.max_forward_mps, 0.0});
  }
  fewer.pop_back();
  const std::size_t driven = fewer.size();
  fewer.resize(driven + 100);
  EXPECT_LT(after(robot, fewer).pose.x_m, 0.25);
}
INSTANTIATE_TEST_SUITE_P(Robots, DiscreteActionsTest, testing::ValuesIn(RobotModel::names()),
                         [](const auto& robot) {
                           std::string name = robot.param;
                           for (char& c : name) c = c == '-' ? '_' : c;
                           return name;
                         });

TEST(DiscreteActions, APeriodBeyondTheCommandTimeoutCounts) {
  const RobotModel robot = RobotModel::jackal_gentle();
  const DiscreteActions actions(robot, 0.5, kSubstep_s, {1.0, 1.0});
  EXPECT_NEAR(after(robot, actions.commands(DiscreteAction::kForward), 0.5).pose.x_m, 1.0,
              1e-9);
}

}  // namespace
}  // namespace segsim::sim
