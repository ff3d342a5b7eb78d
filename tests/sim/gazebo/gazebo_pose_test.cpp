// Streamed poses to camera poses, and which of them are due.

#include "sim/gazebo/gazebo_pose.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/gazebo/internal/gazebo_inbox.h"

namespace segsim::sim {
namespace {

using std::chrono_literals::operator""ms;

glm::dquat yaw(double angle_rad) {
  return {std::cos(0.5 * angle_rad), 0.0, 0.0, std::sin(0.5 * angle_rad)};
}

/// On a link of a robot, looking along the link's x.
GazeboCamera camera_on(std::vector<std::string> path, double rate_hz = 0.0) {
  GazeboCamera camera;
  camera.link_path = std::move(path);
  camera.rate_hz = rate_hz;
  camera.T_link_camera = {glm::dquat(0.5, -0.5, 0.5, -0.5), {0.2, 0.0, 0.9}};
  camera.intrinsics = core::CameraIntrinsics::from_fov(64, 48, 1.2);
  return camera;
}

/// As SceneBroadcaster sends two robots: models first, then links, by number.
std::vector<GazeboEntity> two_robots() {
  return {{"left", 8, {1.0, 2.0, 0.0}, yaw(0.5 * std::numbers::pi)},
          {"right", 20, {-3.0, 0.0, 0.0}, yaw(0.0)},
          {"base_link", 9, {0.0, 0.0, 0.1}, yaw(0.0)},
          {"wheel", 10, {0.3, 0.0, 0.0}, yaw(0.0)},
          {"base_link", 21, {0.0, 0.0, 0.2}, yaw(std::numbers::pi)}};
}

TEST(CameraPose, FollowsModelLinkAndSensor) {
  const CameraPoseResult left = camera_pose(two_robots(), camera_on({"left", "base_link"}));
  ASSERT_EQ(left.fault, PoseFault::kNone);
  // 0.2 m ahead of a robot at (1, 2) that heads north, 0.1 + 0.9 m up.
  const glm::dvec3 p = left.T_world_camera.translation_m();
  EXPECT_NEAR(p.x, 1.0, 1e-12);
  EXPECT_NEAR(p.y, 2.2, 1e-12);
  EXPECT_NEAR(p.z, 1.0, 1e-12);
  // Its optical axis points north, its image's right is east, its image's down is down.
  const auto axis = [&](const glm::dvec3& v) { return left.T_world_camera.rotation() * v; };
  EXPECT_NEAR(axis({0, 0, 1}).y, 1.0, 1e-12);
  EXPECT_NEAR(axis({1, 0, 0}).x, 1.0, 1e-12);
  EXPECT_NEAR(axis({0, 1, 0}).z, -1.0, 1e-12);
}

TEST(CameraPose, LinksOfOneNameBelongToTheModelNumberedBefore) {
  const CameraPoseResult right = camera_pose(two_robots(), camera_on({"right", "base_link"}));
  ASSERT_EQ(right.fault, PoseFault::kNone);
  // Its own link is turned round and 0.2 m up; the other robot's is 0.1 m up.
  EXPECT_NEAR(right.T_world_camera.translation_m().x, -3.2, 1e-12);
  EXPECT_NEAR(right.T_world_camera.translation_m().z, 1.1, 1e-12);
}

TEST(CameraPose, WithoutNumbersTheOrderCounts) {
  std::vector<GazeboEntity> entities = two_robots();
  std::swap(entities[1], entities[3]);  // left, wheel, base_link, right, base_link
  for (GazeboEntity& entity : entities) entity.id = 0;
  const CameraPoseResult right = camera_pose(entities, camera_on({"right", "base_link"}));
  ASSERT_EQ(right.fault, PoseFault::kNone);
  EXPECT_NEAR(right.T_world_camera.translation_m().z, 1.1, 1e-12);
}

TEST(CameraPose, FixedCamerasNeedNoEntities) {
  const CameraPoseResult fixed = camera_pose({}, camera_on({}));
  EXPECT_EQ(fixed.fault, PoseFault::kNone);
  EXPECT_EQ(fixed.T_world_camera.translation_m(), glm::dvec3(0.2, 0.0, 0.9));
}

TEST(CameraPose, NamesWhatIsWrong) {
  const GazeboCamera camera = camera_on({"left", "base_link"});
  const auto fault = [&](std::size_t index, auto&& spoil) {
    std::vector<GazeboEntity> entities = two_robots();
    spoil(entities[index]);
    return camera_pose(entities, camera).fault;
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  EXPECT_EQ(fault(0, [](GazeboEntity& e) { e.position_m.y = kNan; }), PoseFault::kNotFinite);
  EXPECT_EQ(fault(2, [](GazeboEntity& e) { e.position_m.z = kInf; }), PoseFault::kNotFinite);
  EXPECT_EQ(fault(0, [](GazeboEntity& e) { e.position_m.x = -1e300; }), PoseFault::kNotFinite);
  EXPECT_EQ(fault(0, [](GazeboEntity& e) { e.position_m.x = -1e6; }), PoseFault::kNone);
  EXPECT_EQ(fault(2, [](GazeboEntity& e) { e.rotation.x = kNan; }), PoseFault::kNotFinite);
  EXPECT_EQ(fault(0,
                  [](GazeboEntity& e) {
                    e.rotation = {2, 0, 0, 0};
                  }),
            PoseFault::kNotRotation);
  EXPECT_EQ(fault(0,
                  [](GazeboEntity& e) {
                    e.rotation = {0, 0, 0, 0};
                  }),
            PoseFault::kNotRotation);
  EXPECT_EQ(fault(0, [](GazeboEntity& e) { e.name = "other"; }), PoseFault::kUnknownEntity);
  // Somebody else's trouble is not ours.
  EXPECT_EQ(fault(1, [](GazeboEntity& e) { e.position_m.y = kNan; }), PoseFault::kNone);
  EXPECT_EQ(fault(3, [](GazeboEntity& e) { e.rotation = {0, 0, 0, 0}; }), PoseFault::kNone);
}

TEST(CameraPose, RoundedQuaternionsAreMadeUnit) {
  std::vector<GazeboEntity> entities = two_robots();
  entities[0].rotation *= 1.0005;
  const CameraPoseResult pose = camera_pose(entities, camera_on({"left", "base_link"}));
  ASSERT_EQ(pose.fault, PoseFault::kNone);
  EXPECT_NEAR(glm::length(pose.T_world_camera.rotation()), 1.0, 1e-12);
}

/// Frames that are due among poses at the multiples of a period.
int frames(double camera_hz, core::TimeNs pose_period_ns, int poses) {
  CameraSchedule schedule(camera_hz);
  int due = 0;
  for (int i = 0; i < poses; ++i) {
    due += schedule.take(i * pose_period_ns) == PoseTiming::kDue ? 1 : 0;
  }
  return due;
}

TEST(CameraSchedule, DrawsAtTheCamerasRate) {
  EXPECT_EQ(frames(30.0, 16'666'667, 60 * 100), 30 * 100);  // Stamps rounded up,
  EXPECT_EQ(frames(30.0, 16'666'666, 60 * 100), 30 * 100);  // or down.
  EXPECT_EQ(frames(30.0, 20'000'000, 50 * 100), 30 * 100);  // No common multiple.
  EXPECT_EQ(frames(30.0, 1'000'000, 1000 * 100), 30 * 100);
  EXPECT_EQ(frames(30.0, 33'333'333, 30 * 3600), 30 * 3600);
  EXPECT_EQ(frames(60.0, 16'666'667, 60 * 3600), 60 * 3600);
  EXPECT_EQ(frames(60.0, 20'000'000, 50 * 100), 50 * 100);  // No more than there are poses.
  EXPECT_EQ(frames(0.0, 4'000'000, 777), 777);
}

TEST(CameraSchedule, APauseIsNoLossAndAResetStartsAnew) {
  CameraSchedule schedule(10.0);
  EXPECT_EQ(schedule.take(0), PoseTiming::kDue);
  EXPECT_EQ(schedule.take(0), PoseTiming::kRepeated);
  EXPECT_EQ(schedule.take(50'000'000), PoseTiming::kEarly);
  EXPECT_EQ(schedule.take(900'000'000), PoseTiming::kDue);
  EXPECT_EQ(schedule.take(950'000'000), PoseTiming::kEarly);
  EXPECT_EQ(schedule.restarts(), 0U);
  EXPECT_EQ(schedule.take(20'000'000), PoseTiming::kDue);
  EXPECT_EQ(schedule.restarts(), 1U);
}

TEST(GazeboInbox, KeepsTheNewestPoseAndCountsTheRest) {
  const auto views = internal::make_views({camera_on({"left", "base_link"}, 10.0)});
  internal::GazeboInbox inbox(views);
  std::vector<GazeboEntity> entities = two_robots();
  const auto now = internal::GazeboInbox::Clock::now();
  for (int i = 0; i < 100; ++i) {  // Nobody takes them: 1 s of poses at 100 Hz.
    entities[0].position_m.x = i;
    inbox.put(i * 10'000'000LL, entities, now);
  }
  const auto job = inbox.take(0ms);
  ASSERT_TRUE(job);
  EXPECT_EQ(job->stamp_ns, 900'000'000);
  EXPECT_NEAR(job->T_world_camera.translation_m().x, 90.0, 1e-12);
  EXPECT_FALSE(inbox.take(0ms));
  GazeboStatus status;
  inbox.fill(status);
  EXPECT_EQ(status.traffic.poses, 100U);
  EXPECT_EQ(status.traffic.early, 90U);
  EXPECT_EQ(status.traffic.superseded, 9U);
}

TEST(GazeboInbox, AShortStallCostsNoFrame) {
  const auto views = internal::make_views({camera_on({"left", "base_link"}, 10.0)});
  internal::GazeboInbox inbox(views);
  const auto now = internal::GazeboInbox::Clock::now();
  for (int i = 0; i < 3; ++i) inbox.put(i * 100'000'000LL, two_robots(), now);
  for (int i = 0; i < 3; ++i) {
    const auto job = inbox.take(0ms);
    ASSERT_TRUE(job);
    EXPECT_EQ(job->stamp_ns, i * 100'000'000LL);
  }
  EXPECT_FALSE(inbox.take(0ms));
  GazeboStatus status;
  inbox.fill(status);
  EXPECT_EQ(status.traffic.superseded, 0U);
}

TEST(GazeboInbox, AFaultyPoseLeavesTheTurnToTheNext) {
  const auto views = internal::make_views({camera_on({"left", "base_link"}, 10.0)});
  internal::GazeboInbox inbox(views);
  std::vector<GazeboEntity> entities = two_robots();
  entities[0].position_m.x = std::numeric_limits<double>::quiet_NaN();
  const auto now = internal::GazeboInbox::Clock::now();
  inbox.put(100'000'000, entities, now);
  inbox.put(110'000'000, two_robots(), now);
  inbox.put({}, two_robots(), now);
  inbox.put_unreadable(17);
  const auto job = inbox.take(0ms);
  ASSERT_TRUE(job);
  EXPECT_EQ(job->stamp_ns, 110'000'000);
  GazeboStatus status;
  inbox.fill(status);
  EXPECT_EQ(status.traffic.poses, 4U);
  EXPECT_EQ(status.traffic.faults(), 3U);
  EXPECT_EQ(status.traffic.faulty[static_cast<int>(PoseFault::kNotFinite)], 1U);
  EXPECT_EQ(status.traffic.faulty[static_cast<int>(PoseFault::kNoTime)], 1U);
  EXPECT_EQ(status.traffic.faulty[static_cast<int>(PoseFault::kUnreadable)], 1U);
  EXPECT_THAT(status.traffic.last_fault, ::testing::HasSubstr("17 other bytes"));
}

TEST(GazeboInbox, EqualCamerasShareAView) {
  GazeboCamera labels = camera_on({"left", "base_link"});
  labels.labels_topic = "/panoptic/labels_map";
  GazeboCamera narrow = camera_on({"left", "base_link"});
  narrow.intrinsics.fx_px *= 2.0;
  const auto views = internal::make_views(
      {camera_on({"left", "base_link"}), narrow, camera_on({"right", "base_link"}), labels});
  ASSERT_EQ(views.size(), 3U);
  EXPECT_EQ(views[0].cameras.size(), 2U);
  EXPECT_EQ(views[0].cameras[1].labels_topic, "/panoptic/labels_map");
}

}  // namespace
}  // namespace segsim::sim
