// Contacts, odometry, and the two models of collision.
#include <cmath>

#include <gtest/gtest.h>

#include "tests/sim/trial/timed_trial.h"

namespace segsim::sim {
namespace {

using TrialContactTest = TimedTrialTest;

TEST_F(TrialContactTest, ContactsAreRecorded) {
  episode_.start = {19.0, 10.0, 0.0};
  options_.time_limit_s = 3.0;
  core::SceneManifest manifest;
  manifest.instances = {{7, 4, "wall_panel", {19.9, 8.0, 0.0}, {20.2, 12.0, 2.0}}};
  world_.set_manifest(manifest);
  const TrialResult result = run([](const auto&) { return command(0.5, 0.0); });
  ASSERT_EQ(result.contact_log.size(), 1U);
  const ContactRecord& contact = result.contact_log[0];
  EXPECT_NEAR(contact.point_m.x, 20.0, 0.03);
  EXPECT_NEAR(contact.normal.x, -1.0, 1e-6);
  EXPECT_NEAR(contact.approach_mps, 0.5, 1e-9);
  EXPECT_EQ(contact.instance, 7);
  EXPECT_NEAR(contact.duration_s, result.contact_s, 1e-12);
}

TEST_F(TrialContactTest, WithOdometryThePolicySeesAnEstimate) {
  options_.odometry = OdometryNoise::skid_steered_indoors();
  NotingPolicy policy(weave);
  const TrialResult result = run(policy);
  const core::Pose2 truth = result.track.back().pose, told = policy.poses_.back();
  const double off_m = std::hypot(told.x_m - truth.x_m, told.y_m - truth.y_m);
  EXPECT_GT(off_m, 1e-4);
  EXPECT_LT(off_m, 1.0);
  EXPECT_NEAR(result.final_estimate.x_m, told.x_m, 1e-12) << "the last tick is the end";
  EXPECT_NEAR(result.track.back().estimate.x_m, told.x_m, 1e-12);
  EXPECT_EQ(policy.poses_.front().x_m, episode_.start.x_m);
  // Commands do not depend on the pose here, so the true way is the one without odometry.
  options_.odometry.reset();
  EXPECT_EQ(run(weave).path_m, result.path_m);
}

TEST_F(TrialContactTest, ABaseThatSlidesGetsFartherThanOneThatStops) {
  episode_.start = {19.0, 10.0, 0.8};
  options_.time_limit_s = 4.0;
  const auto ahead = [](const auto&) { return command(0.5, 0.0); };
  const TrialResult stopped = run(ahead);
  options_.contact_response = ContactResponse::kSlide;
  const TrialResult slid = run(ahead);
  EXPECT_EQ(stopped.contact_log.size(), 1U);
  EXPECT_EQ(slid.contact_log.size(), 1U);
  EXPECT_GT(slid.track.back().pose.y_m, stopped.track.back().pose.y_m + 0.3);
}

/// A rectangle can hit while it turns; Habitat's point cannot.
TEST_F(TrialContactTest, TurningBesideAWallCollidesForAFootprintButNotOnTheNavmesh) {
  episode_.start = {10.0, 19.74, 0.0};  // 4.5 cm beside the wall at y = 20.
  options_.time_limit_s = 3.0;
  const auto turn = [](const auto&) { return command(0.0, 1.0); };
  EXPECT_GE(run(turn).contacts, 1);
  options_.collision = CollisionMode::kNavmesh;
  const TrialResult point = run(turn);
  EXPECT_EQ(point.contacts, 0);
  EXPECT_GT(core::wrap_angle_rad(point.final_pose.yaw_rad), 2.0);
  EXPECT_LT(point.track.front().pose.y_m, 20.0 - robot_.circumscribed_radius_m() + 1e-6)
      << "it begins on the eroded mesh";
}

TEST_F(TrialContactTest, OnTheNavmeshARobotStopsAtTheEdgeOrSlidesAlongIt) {
  episode_.start = {19.0, 10.0, 0.8};
  options_.collision = CollisionMode::kNavmesh;
  options_.time_limit_s = 4.0;
  const auto ahead = [](const auto&) { return command(0.5, 0.0); };
  const TrialResult stopped = run(ahead);
  ASSERT_EQ(stopped.contact_log.size(), 1U);
  EXPECT_NEAR(stopped.contact_log[0].normal.x, -1.0, 0.01);
  EXPECT_NEAR(stopped.contact_log[0].approach_mps, 0.5 * std::cos(0.8), 0.01);
  EXPECT_NEAR(stopped.final_pose.x_m, 20.0 - 0.35, 0.06);
  options_.contact_response = ContactResponse::kSlide;
  const TrialResult slid = run(ahead);
  EXPECT_GT(slid.final_pose.y_m, stopped.final_pose.y_m + 0.3);
  EXPECT_NEAR(slid.final_pose.x_m, stopped.final_pose.x_m, 0.01);
  expect_same_ticks(slid, run(ahead));
}

}  // namespace
}  // namespace segsim::sim
