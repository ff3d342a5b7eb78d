// Where a model of Gazebo was, between the transport's thread and a trial.

#include "sim/gazebo/internal/model_track.h"

#include <cmath>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace segsim::sim::internal {
namespace {

using std::chrono_literals::operator""ms;
using ::testing::HasSubstr;

constexpr core::TimeNs kMs = 1'000'000;

/// Turned about z first, then rolled.
std::vector<GazeboEntity> jackal_at(double x_m, double yaw_rad, double roll_rad = 0.0) {
  const glm::dquat yaw(std::cos(0.5 * yaw_rad), 0.0, 0.0, std::sin(0.5 * yaw_rad));
  const glm::dquat roll(std::cos(0.5 * roll_rad), std::sin(0.5 * roll_rad), 0.0, 0.0);
  return {{"crate", 3, {9.0, 9.0, 0.0}, {1.0, 0.0, 0.0, 0.0}},
          {"jackal", 8, {x_m, -1.0, 0.06}, yaw * roll},
          {"base_link", 9, {0.0, 0.0, 0.1}, {1.0, 0.0, 0.0, 0.0}}};
}

TEST(ModelTrack, GivesPosesOnceAndInTheirOrder) {
  ModelTrack track("jackal");
  EXPECT_FALSE(track.take(-1, 0ms));
  for (int k = 1; k <= 3; ++k) track.put(10 * k * kMs, jackal_at(0.1 * k, 0.2));
  const auto first = track.take(-1, 0ms);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->stamp_ns, 10 * kMs);
  EXPECT_NEAR(first->pose.x_m, 0.1, 1e-12);
  EXPECT_NEAR(first->pose.yaw_rad, 0.2, 1e-12);
  EXPECT_NEAR(first->height_m, 0.06, 1e-12);
  EXPECT_EQ(track.take(20 * kMs, 0ms)->stamp_ns, 30 * kMs) << "20 ms was not asked for";
  EXPECT_FALSE(track.take(-1, 0ms));
  EXPECT_EQ(track.newest()->stamp_ns, 30 * kMs);
  EXPECT_FALSE(track.wait_newer(30 * kMs, 0ms));
  EXPECT_TRUE(track.wait_newer(29 * kMs, 0ms));
}

TEST(ModelTrack, APausedGazeboGivesNothingNew) {
  ModelTrack track("jackal");
  track.put(10 * kMs, jackal_at(1.0, 0.0));
  track.put(10 * kMs, jackal_at(1.0, 0.0));
  EXPECT_TRUE(track.take(-1, 0ms));
  EXPECT_FALSE(track.take(-1, 0ms));
  EXPECT_EQ(track.restarts(), 0U);
}

TEST(ModelTrack, AClockThatWentBackIsCounted) {
  ModelTrack track("jackal");
  track.put(50 * kMs, jackal_at(1.0, 0.0));
  track.put(10 * kMs, jackal_at(2.0, 0.0));
  EXPECT_EQ(track.restarts(), 1U);
  EXPECT_EQ(track.take(-1, 0ms)->stamp_ns, 10 * kMs);
  EXPECT_FALSE(track.take(-1, 0ms)) << "the pose before the restart";
}

TEST(ModelTrack, SaysWhatIsWrong) {
  ModelTrack track("husky");
  EXPECT_EQ(track.last_fault(), "");
  track.put(10 * kMs, jackal_at(1.0, 0.0));
  EXPECT_FALSE(track.newest());
  EXPECT_EQ(track.last_fault(), "poses of others than 'husky'");
  track.put(std::nullopt, jackal_at(1.0, 0.0));
  EXPECT_EQ(track.last_fault(), "a message without time");
  track.put_unreadable();
  EXPECT_EQ(track.last_fault(), "messages that are no poses");
  ModelTrack other("jackal");
  other.put(10 * kMs, jackal_at(std::nan(""), 0.0));
  EXPECT_THAT(other.last_fault(), HasSubstr("'jackal' that is not finite"));
}

TEST(ModelTrack, KnowsARobotThatFellOver) {
  ModelTrack track("jackal");
  track.put(10 * kMs, jackal_at(1.0, 0.7, 1.5));
  EXPECT_NEAR(track.newest()->upright, std::cos(1.5), 1e-9);
}

TEST(PoseBetween, TurnsTheShortWay) {
  constexpr double kPi = std::numbers::pi;
  const ModelPose a{100, {1.0, 2.0, kPi - 0.1}, 0.0, 1.0};
  const ModelPose b{200, {3.0, 2.0, -kPi + 0.3}, 0.0, 1.0};
  const core::Pose2 middle = pose_between(a, b, 150);
  EXPECT_NEAR(middle.x_m, 2.0, 1e-12);
  EXPECT_NEAR(middle.y_m, 2.0, 1e-12);
  EXPECT_NEAR(middle.yaw_rad, -kPi + 0.1, 1e-12);
  EXPECT_NEAR(pose_between(a, b, 125).x_m, 1.5, 1e-12);
}

}  // namespace
}  // namespace segsim::sim::internal
