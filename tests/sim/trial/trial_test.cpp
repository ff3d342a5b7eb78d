#include "sim/trial/trial.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/error.h"
#include "sim/trial/oracle_detector.h"
#include "tests/box_mesh.h"
#include "tests/sim/rooms.h"
#include "tests/sim/trial/box_renderer.h"

namespace segsim::sim {
namespace {

constexpr std::uint16_t kWall = 1, kCouch = 4;

/// Repeats a list of commands with durations, then stops.
class ScriptedPolicy final : public core::Policy {
 public:
  struct Part {
    int ticks = 0;
    core::VelocityCommand command;
  };
  /// @param reason  None: it stands still instead of stopping.
  explicit ScriptedPolicy(std::vector<Part> parts, std::optional<core::StopReason> reason =
                                                       core::StopReason::kGoalReached)
      : parts_(std::move(parts)), reason_(reason) {}

  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override {
    goal_ = goal;
    seed_ = seed;
    tick_ = 0;
    depths_seen_ = 0;
  }
  core::Decision decide(const core::Observation& observation,
                        std::span<const core::Detection> detections) override {
    last_pose_m_ = observation.T_odom_robot.translation_m();
    for (const float d : observation.depth_m->pixels()) {
      if (std::isfinite(d)) {
        ++depths_seen_;
        farthest_m_ = std::max(farthest_m_, d);
      }
    }
    most_detections_ = std::max(most_detections_, detections.size());
    int until = 0;
    for (const Part& part : parts_) {
      until += part.ticks;
      if (tick_ < until) {
        ++tick_;
        return {part.command, core::PolicyMode::kNavigate};
      }
    }
    return {{}, core::PolicyMode::kStop, reason_};
  }
  core::PolicyView view() const override {
    core::PolicyView view;
    view.resolution_m = 0.125;
    return view;
  }

  core::ObjectGoal goal_;
  std::uint64_t seed_ = 0;
  glm::dvec3 last_pose_m_{0.0};
  std::size_t depths_seen_ = 0, most_detections_ = 0;
  float farthest_m_ = 0.0F;

 private:
  std::vector<Part> parts_;
  std::optional<core::StopReason> reason_;
  int tick_ = 0;
};

/// Two rooms; the couch stands in the right one. The robot starts in the left one, looking at
/// the gap.
class Trial : public testing::Test {
 protected:
  Trial() : world_(World::from_mesh(make_mesh(), robot_)) {
    core::SceneManifest manifest;
    manifest.classes = {{kWall, "wall", false}, {kCouch, "couch", true}};
    world_.set_manifest(manifest);
    options_.camera = core::CameraIntrinsics::from_fov(64, 48, 1.4);
    options_.time_limit_s = 30.0;
    episode_.id = "rooms/couch/00";
    episode_.class_name = "couch";
    episode_.start = {1.0, 3.3, 0.0};
    episode_.view_points_m = {{4.7, 3.3}};
    episode_.shortest_path_m = 3.7;
    episode_.seed = 42;
  }

  static TriangleMesh make_mesh() {
    TriangleMesh mesh = make_two_rooms();
    append_box(mesh, {5.3F, 2.4F, 0.0F}, {6.0F, 4.0F, 0.7F});
    return mesh;
  }

  TrialResult run(core::Policy& policy, const TickObserver& observer = {}) {
    BoxRenderer renderer({{{5.3, 2.4, 0.0}, {6.0, 4.0, 0.7}, kCouch, 1},
                          {{2.9, 0.0, 0.0}, {3.1, 2.6, 2.0}, kWall, 0}});
    OracleDetector detector(world_.manifest().classes, {"chair", "couch"});
    return run_trial({.episode = episode_,
                      .options = options_,
                      .world = world_,
                      .robot = robot_,
                      .renderer = renderer,
                      .detector = detector,
                      .policy = policy,
                      .truth = &detector,
                      .observer = observer});
  }

  RobotModel robot_ = RobotModel::jackal_gentle();
  World world_;
  TrialOptions options_;
  Episode episode_;
};

using Parts = std::vector<ScriptedPolicy::Part>;
const Parts kStopAtOnce;
// 0.8 m/s for 44 ticks: 3.52 m less 0.16 m lost while gathering speed.
const Parts kToTheCouch = {{44, {0.8, 0.0}}, {6, {0.0, 0.0}}};

TEST_F(Trial, StopNearAVisibleGoalSucceeds) {
  ScriptedPolicy policy(kToTheCouch);
  int observed = 0;
  const TrialResult result =
      run(policy, [&](const TickRecord&, const core::Frame& frame, const auto&, const auto&) {
        ++observed;
        EXPECT_EQ(frame.semantic.width_px(), 64);
      });
  EXPECT_EQ(result.outcome, Outcome::kSuccess) << to_string(result.outcome);
  EXPECT_TRUE(result.success);
  EXPECT_EQ(result.ticks, 51);
  EXPECT_EQ(observed, 51);
  EXPECT_EQ(result.track.size(), 51U);
  EXPECT_NEAR(result.sim_s, 5.0, 1e-9);
  EXPECT_NEAR(result.path_m, 3.52, 0.01);
  EXPECT_DOUBLE_EQ(result.spl, 1.0) << "shorter than l: clamped";
  EXPECT_NEAR(result.distance_to_goal_m, 0.18, 0.01);
  EXPECT_NEAR(result.soft_spl, 1.0 - result.distance_to_goal_m / 3.7, 1e-9);
  EXPECT_EQ(result.contacts, 0);
  EXPECT_EQ(result.first_visible_tick, 0);
  EXPECT_EQ(result.first_detected_tick, 0);
  EXPECT_GT(result.track.back().goal_pixels, result.track.front().goal_pixels);
  EXPECT_EQ(result.final_view.resolution_m, 0.125);
  // What the policy was told.
  EXPECT_EQ(policy.goal_.class_index, 1);
  EXPECT_EQ(policy.seed_, 42U);
  EXPECT_EQ(policy.most_detections_, 1U);
  EXPECT_GT(policy.depths_seen_, 0U);
  EXPECT_LE(policy.farthest_m_, 6.0F);
  EXPECT_NEAR(policy.last_pose_m_.x, result.track.back().pose.x_m, 1e-12);
  EXPECT_GT(result.invalid_pixel_fraction, 0.0) << "sky";
  EXPECT_LT(result.invalid_pixel_fraction, 0.6);
}

TEST_F(Trial, EqualArgumentsGiveEqualResults) {
  ScriptedPolicy policy({{10, {0.5, 0.4}}, {20, {0.8, -0.7}}, {10, {0.6, 0.2}}});
  const TrialResult a = run(policy);
  const TrialResult b = run(policy);
  EXPECT_EQ(a.state_hash, b.state_hash);
  EXPECT_EQ(a.path_m, b.path_m);
  ASSERT_EQ(a.track.size(), b.track.size());
  episode_.start.x_m += 2e-6;
  EXPECT_NE(run(policy).state_hash, a.state_hash);
}

TEST_F(Trial, StopFarFromTheGoal) {
  ScriptedPolicy policy(Parts{{5, {0.5, 0.0}}});
  const TrialResult result = run(policy);
  EXPECT_EQ(result.outcome, Outcome::kStoppedFar);
  EXPECT_DOUBLE_EQ(result.spl, 0.0);
  EXPECT_GT(result.soft_spl, 0.0);
}

TEST_F(Trial, SuccessDistanceIsStrict) {
  ScriptedPolicy policy(kStopAtOnce);
  options_.success_distance_m = world_.distance_to(episode_.view_points_m).at({1.0, 3.3});
  EXPECT_EQ(run(policy).outcome, Outcome::kStoppedFar);
  options_.success_distance_m += 1e-6;
  EXPECT_EQ(run(policy).outcome, Outcome::kSuccess);
}

TEST_F(Trial, StopWithoutTheGoalInView) {
  // On the spot, but turned away.
  episode_.start = {4.5, 3.3, std::numbers::pi};
  ScriptedPolicy policy(kStopAtOnce);
  const TrialResult result = run(policy);
  EXPECT_EQ(result.outcome, Outcome::kNotVisible);
  EXPECT_FALSE(result.success);
  EXPECT_EQ(result.first_visible_tick, -1);
  options_.require_visible = false;
  EXPECT_EQ(run(policy).outcome, Outcome::kSuccess);
}

TEST_F(Trial, GivingUpIsNoSuccessEvenNearTheGoal) {
  ScriptedPolicy policy(kToTheCouch, core::StopReason::kNoFrontierLeft);
  const TrialResult result = run(policy);
  EXPECT_EQ(result.outcome, Outcome::kGaveUp);
  EXPECT_EQ(result.stop_reason, core::StopReason::kNoFrontierLeft);
  EXPECT_FALSE(result.success);
}

TEST_F(Trial, TimeoutAndStopAtTheLimit) {
  ScriptedPolicy never(kStopAtOnce, std::nullopt);
  options_.time_limit_s = 1.0;
  const TrialResult result = run(never);
  EXPECT_EQ(result.outcome, Outcome::kTimeout);
  EXPECT_EQ(result.stop_reason, std::nullopt);
  EXPECT_EQ(result.ticks, 11);
  EXPECT_NEAR(result.sim_s, 1.0, 1e-9);
  // The decision at exactly the limit still counts.
  ScriptedPolicy last_moment(Parts{{10, {0.0, 0.0}}});
  EXPECT_EQ(run(last_moment).outcome, Outcome::kStoppedFar);
  ScriptedPolicy too_late(Parts{{11, {0.0, 0.0}}});
  EXPECT_EQ(run(too_late).outcome, Outcome::kTimeout);
}

TEST_F(Trial, ContactsAreCountedOncePerTouch) {
  // Into the wall behind for 1.5 s, 1 s away, into it again.
  ScriptedPolicy policy({{25, {-0.8, 0.0}}, {10, {0.8, 0.0}}, {25, {-0.8, 0.0}}});
  const TrialResult result = run(policy);
  EXPECT_EQ(result.contacts, 2);
  EXPECT_GT(result.contact_s, 0.5);
  EXPECT_TRUE(result.track.back().in_contact);
  EXPECT_FALSE(result.track.front().in_contact);

  options_.stop_on_contact = true;
  const TrialResult ended = run(policy);
  EXPECT_EQ(ended.outcome, Outcome::kCollision);
  EXPECT_EQ(ended.contacts, 1);
  EXPECT_LT(ended.ticks, 25);
}

TEST_F(Trial, UnreachableGoalGivesNumbers) {
  episode_.view_points_m = {{-3.0, 0.0}};
  episode_.shortest_path_m = std::numeric_limits<double>::infinity();
  ScriptedPolicy policy(kStopAtOnce);
  const TrialResult result = run(policy);
  EXPECT_EQ(result.outcome, Outcome::kStoppedFar);
  EXPECT_TRUE(std::isinf(result.distance_to_goal_m));
  EXPECT_EQ(result.spl, 0.0);
  EXPECT_EQ(result.soft_spl, 0.0);
}

TEST_F(Trial, RefusesAStartInAWall) {
  episode_.start = {3.0, 1.0, 0.0};
  ScriptedPolicy policy(kStopAtOnce);
  EXPECT_THROW((void)run(policy), core::InputError);
}

}  // namespace
}  // namespace segsim::sim
