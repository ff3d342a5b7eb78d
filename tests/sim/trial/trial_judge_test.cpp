#include "sim/trial/internal/trial_judge.h"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/sim/rooms.h"

namespace segsim::sim::internal {
namespace {

constexpr core::Pose2 kNear{4.8, 3.0, 0.0}, kFar{1.5, 3.0, 0.0};
constexpr GoalView kInView{300, 200}, kTooSmall{100, 39};

class TrialJudgeTest : public testing::Test {
 protected:
  TrialJudgeTest() : world_(World::from_mesh(make_room(8.0F, 6.0F), robot_)) {
    episode_.view_points_m = {{5.0, 3.0}};
    episode_.shortest_path_m = 4.0;
    options_.time_limit_s = 30.0;
  }
  TrialResult scored(const TrialJudge& judge, const core::Pose2& end = kNear) {
    TrialResult result;
    result.path_m = 8.0;
    judge.score(end, kTooSmall, result);
    return result;
  }
  TrialResult after_stop(core::StopReason reason, const core::Pose2& pose,
                         const GoalView& view) {
    TrialJudge judge(episode_, options_, world_);
    judge.stopped(reason, pose, view);
    return scored(judge, pose);
  }

  RobotModel robot_ = RobotModel::jackal_gentle();
  World world_;
  TrialOptions options_;
  Episode episode_;
};

TEST_F(TrialJudgeTest, AStopAtTheGoalSucceeds) {
  const TrialResult result = after_stop(core::StopReason::kGoalReached, kNear, kInView);
  EXPECT_EQ(result.outcome, Outcome::kSuccess);
  EXPECT_TRUE(result.success);
  EXPECT_EQ(result.stop_reason, core::StopReason::kGoalReached);
  EXPECT_EQ(result.final_goal_pixels, 200) << "of the view that was judged";
  EXPECT_NEAR(result.distance_to_goal_m, 0.2, 0.03);
  EXPECT_EQ(result.shortest_path_m, 4.0);
  EXPECT_EQ(result.spl, 0.5);
  EXPECT_NEAR(result.soft_spl, 0.5 * (1.0 - result.distance_to_goal_m / 4.0), 1e-12);
}

TEST_F(TrialJudgeTest, AStopElsewhereOrWithoutTheGoalInViewFails) {
  const auto outcome = [&](const core::Pose2& pose, const GoalView& view) {
    return after_stop(core::StopReason::kGoalReached, pose, view).outcome;
  };
  EXPECT_EQ(outcome(kFar, kInView), Outcome::kStoppedFar);
  EXPECT_EQ(outcome(kNear, kTooSmall), Outcome::kNotVisible);
  options_.require_visible = false;
  EXPECT_EQ(outcome(kNear, kTooSmall), Outcome::kSuccess);
}

TEST_F(TrialJudgeTest, NearIsStrict) {
  TrialJudge judge(episode_, options_, world_);
  options_.success_distance_m = judge.distance_m(kNear);
  judge.stopped(core::StopReason::kGoalReached, kNear, kInView);
  EXPECT_EQ(scored(judge).outcome, Outcome::kStoppedFar);
  options_.success_distance_m += 1e-9;
  judge.stopped(core::StopReason::kGoalReached, kNear, kInView);
  EXPECT_EQ(scored(judge).outcome, Outcome::kSuccess);
}

TEST_F(TrialJudgeTest, EveryOtherReasonIsGivingUpWhereverItIs) {
  for (int k = 0; k <= static_cast<int>(core::StopReason::kStepFailed); ++k) {
    const auto reason = static_cast<core::StopReason>(k);
    if (reason == core::StopReason::kGoalReached) continue;
    const TrialResult result = after_stop(reason, kNear, kInView);
    EXPECT_EQ(result.outcome, Outcome::kGaveUp) << to_string(reason);
    EXPECT_EQ(result.stop_reason, reason);
    EXPECT_EQ(result.spl, 0.0);
  }
}

TEST_F(TrialJudgeTest, WithoutAStopTheLastViewIsTheFinalOne) {
  TrialJudge judge(episode_, options_, world_);
  EXPECT_EQ(scored(judge).outcome, Outcome::kTimeout);
  EXPECT_EQ(scored(judge).final_goal_pixels, kTooSmall.largest_instance);
  EXPECT_EQ(scored(judge).stop_reason, std::nullopt);
  judge.collided();
  EXPECT_EQ(scored(judge).outcome, Outcome::kCollision);
  judge.aborted();
  EXPECT_EQ(scored(judge).outcome, Outcome::kAborted);
}

TEST_F(TrialJudgeTest, TheLimitItselfIsInTime) {
  const TrialJudge judge(episode_, options_, world_);
  EXPECT_TRUE(judge.in_time(30 * core::kNsPerSecond));
  EXPECT_FALSE(judge.in_time(30 * core::kNsPerSecond + 1));
}

TEST_F(TrialJudgeTest, ADriveWithoutAGoalHasNoDistance) {
  episode_.view_points_m.clear();
  EXPECT_TRUE(std::isinf(TrialJudge(episode_, options_, world_).distance_m(kNear)));
}

}  // namespace
}  // namespace segsim::sim::internal
