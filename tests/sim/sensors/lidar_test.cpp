#include "sim/sensors/lidar.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "sim/ground/robot.h"
#include "tests/box_mesh.h"
#include "tests/sim/rooms.h"

namespace segsim::sim {
namespace {

constexpr core::Pose2 kPose{1.3, 2.1, 0.4};

LidarModel exact() {
  LidarModel model;
  model.sigma_m = 0.0;
  return model;
}

std::vector<float> scan_at(const LidarModel& model, const RayScene& scene,
                           const core::Pose2& pose = kPose, std::uint64_t index = 0) {
  return scan(
      model, scene, [&](core::TimeNs) { return pose; }, 0, 1, index);
}

/// Distance from a point within [0, x] x [0, y] to its border.
double to_border(double x_m, double y_m, double px, double py, double angle) {
  const double dx = std::cos(angle), dy = std::sin(angle);
  double t = 1e9;
  if (dx > 0) t = std::min(t, (x_m - px) / dx);
  if (dx < 0) t = std::min(t, -px / dx);
  if (dy > 0) t = std::min(t, (y_m - py) / dy);
  if (dy < 0) t = std::min(t, -py / dy);
  return t;
}

/// The range of a beam in an empty room, by hand.
double expected_m(const LidarModel& model, const core::Pose2& pose, int beam) {
  return to_border(6.0, 4.0, pose.x_m + model.forward_m * std::cos(pose.yaw_rad),
                   pose.y_m + model.forward_m * std::sin(pose.yaw_rad),
                   pose.yaw_rad + model.angle_rad(beam));
}

TEST(Lidar, TheDefaultIsTheUst10) {
  const LidarModel model;
  EXPECT_EQ(model.beams, 720);
  EXPECT_NEAR(model.angle_rad(0), -2.35619, 1e-12);
  EXPECT_NEAR(model.angle_rad(719), 2.35619, 1e-12);
  EXPECT_NEAR(model.angle_rad(1) - model.angle_rad(0), 0.00655408, 1e-8);
}

TEST(Lidar, AnEmptyRoom) {
  const auto scene = make_ray_scene(make_room(6.0F, 4.0F));
  const std::vector<float> found = scan_at(exact(), *scene);
  ASSERT_EQ(found.size(), 720U);
  for (int beam = 0; beam < 720; ++beam) {
    EXPECT_NEAR(found[static_cast<std::size_t>(beam)], expected_m(exact(), kPose, beam), 2e-6)
        << beam;
  }
}

TEST(Lidar, WhatIsLowerThanTheRaysIsNotSeen) {
  TriangleMesh mesh = make_room(6.0F, 4.0F);
  append_box(mesh, {2.0F, 0.0F, 0.0F}, {2.4F, 4.0F, 0.25F});
  append_box(mesh, {4.0F, 0.0F, 0.5F}, {4.4F, 4.0F, 1.0F});
  LidarModel model = exact();
  model.forward_m = 0.0;
  const core::Pose2 pose{1.0, 2.0, 0.0};
  const auto ahead = [&](double height_m) {
    model.height_m = height_m;
    model.beams = 3;
    return scan_at(model, *make_ray_scene(mesh), pose)[1];
  };
  EXPECT_NEAR(ahead(0.30), 5.0, 1e-5);
  EXPECT_NEAR(ahead(0.10), 1.0, 1e-5);
  EXPECT_NEAR(ahead(0.70), 3.0, 1e-5);
}

TEST(Lidar, RangesEnd) {
  const auto scene = make_ray_scene(make_room(6.0F, 4.0F));
  LidarModel model = exact();
  model.max_range_m = 2.0;
  model.min_range_m = 1.9;
  const std::vector<float> found = scan_at(model, *scene);
  int kept = 0;
  for (int beam = 0; beam < model.beams; ++beam) {
    const double truth_m = expected_m(model, kPose, beam);
    if (std::abs(truth_m - 2.0) < 1e-4 || std::abs(truth_m - 1.9) < 1e-4) continue;
    const bool in_range = truth_m > 1.9 && truth_m < 2.0;
    EXPECT_EQ(!std::isnan(found[static_cast<std::size_t>(beam)]), in_range) << beam;
    kept += in_range ? 1 : 0;
  }
  EXPECT_GT(kept, 5);
  // Under the open sky.
  TriangleMesh floor;
  append_floor(floor, -1, -1, 1, 1);
  for (const float range_m : scan_at(LidarModel{}, *make_ray_scene(floor))) {
    EXPECT_TRUE(std::isnan(range_m));
  }
}

TEST(Lidar, NoiseIsAMillimetre) {
  const auto scene = make_ray_scene(make_room(6.0F, 4.0F));
  const std::vector<float> truth = scan_at(exact(), *scene);
  double sum = 0.0, squares = 0.0;
  constexpr int kScans = 40;
  for (std::uint64_t index = 0; index < kScans; ++index) {
    const std::vector<float> found = scan_at(LidarModel{}, *scene, kPose, index);
    for (std::size_t k = 0; k < found.size(); ++k) {
      const double e = double{found[k]} - truth[k];
      sum += e;
      squares += e * e;
    }
  }
  constexpr double kReadings = 720.0 * kScans;
  EXPECT_NEAR(sum / kReadings, 0.0, 4.0 * 0.001 / std::sqrt(kReadings));
  EXPECT_NEAR(std::sqrt(squares / kReadings), 0.001, 2e-5);
  EXPECT_EQ(scan_at(LidarModel{}, *scene, kPose, 3), scan_at(LidarModel{}, *scene, kPose, 3));
}

TEST(Lidar, ATurningRobotSmearsItsScan) {
  const auto scene = make_ray_scene(make_room(6.0F, 4.0F));
  LidarModel model = exact();
  model.sweep_s = 0.015;
  model.forward_m = 0.0;
  constexpr double kTurn_radps = 2.0;
  const auto pose_at = [](core::TimeNs t) {
    return drive_arc(kPose, {0.0, kTurn_radps}, core::seconds(t));
  };
  const std::vector<float> found = scan(model, *scene, pose_at, 0, 1, 0);
  LidarModel at_once = model;
  at_once.sweep_s = 0.0;
  const std::vector<float> still = scan(at_once, *scene, pose_at, 0, 1, 0);
  EXPECT_EQ(found.front(), still.front());
  double largest_m = 0.0;
  for (int beam = 0; beam < model.beams; ++beam) {
    // Beam i is taken 0.015 s i / 719 later, when the robot has turned on.
    const double turned = kTurn_radps * 0.015 * beam / 719.0;
    const auto k = static_cast<std::size_t>(beam);
    const double expected = to_border(6.0, 4.0, kPose.x_m, kPose.y_m,
                                      kPose.yaw_rad + model.angle_rad(beam) + turned);
    EXPECT_NEAR(found[k], expected, 1e-5) << beam;
    largest_m = std::max(largest_m, std::abs(double{found[k]} - still[k]));
  }
  EXPECT_GT(largest_m, 0.03) << "the smear is there to be seen";
}

}  // namespace
}  // namespace segsim::sim
