#pragma once

// A robot in an empty room whose policy does as the test says: for trials in which time,
// faults and contacts are what counts.
#include <chrono>
#include <cmath>
#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "sim/trial/trial.h"
#include "tests/sim/rooms.h"
#include "tests/sim/trial/box_renderer.h"

namespace segsim::sim {

inline constexpr core::TimeNs kMs = 1'000'000;

/// Answers as the test wants and notes what it was shown.
class NotingPolicy final : public core::Policy {
 public:
  using Answer = std::function<core::Decision(const core::Observation&)>;
  explicit NotingPolicy(Answer answer) : answer_(std::move(answer)) {}
  void reset(const core::ObjectGoal&, std::uint64_t) override { poses_.clear(); }
  core::Decision decide(const core::Observation& seen,
                        std::span<const core::Detection>) override {
    const glm::dvec3 p = seen.T_odom_robot.translation_m();
    const glm::dvec3 ahead = seen.T_odom_robot.rotation() * glm::dvec3(1.0, 0.0, 0.0);
    poses_.push_back({p.x, p.y, std::atan2(ahead.y, ahead.x)});
    return answer_(seen);
  }
  core::PolicyView view() const override { return {}; }

  std::vector<core::Pose2> poses_;

 private:
  Answer answer_;
};

inline core::Decision command(double forward_mps, double turn_radps) {
  return {{forward_mps, turn_radps}, core::PolicyMode::kExplore};
}

/// Weaves, so that every tick matters.
inline core::Decision weave(const core::Observation& seen) {
  const double t = core::seconds(seen.capture_time_ns);
  return command(0.4 + 0.2 * std::sin(t), 0.8 * std::cos(1.7 * t));
}

/// Needs a while and finds nothing.
class SlowDetector final : public core::Detector {
 public:
  const std::vector<std::string>& class_names() const override { return names_; }
  std::vector<core::Detection> detect(const core::Observation& seen) override {
    std::this_thread::sleep_for(std::chrono::milliseconds(1 + seen.capture_index % 3));
    return std::vector<core::Detection>(found_, core::Detection{0, 0.5F, {1, 1, 5, 5}});
  }
  std::size_t found_ = 0;

 private:
  std::vector<std::string> names_{"couch"};
};

inline StageBudget stage(const std::string& name, double ms, const std::string& on = "") {
  StageBudget made;
  made.name = name;
  made.on = on;
  made.duration.a_ms = ms;
  return made;
}

class TimedTrialTest : public testing::Test {
 protected:
  TimedTrialTest() : world_(World::from_mesh(make_room(20.0F, 20.0F), robot_)) {
    options_.camera = core::CameraIntrinsics::from_fov(16, 12, 1.4);
    options_.time_limit_s = 12.0;
    episode_.class_name = "couch";
    episode_.start = {10.0, 10.0, 0.3};
    episode_.view_points_m = {{1.0, 1.0}};
    episode_.shortest_path_m = 12.0;
    episode_.seed = 42;
  }

  void play(double capture_ms, double detect_ms, double policy_ms, double actuate_ms) {
    options_.clock.mode = ClockMode::kVirtual;
    LatencyBudget& budget = options_.clock.budget;
    budget.resources = {{"gpu", 1}, {"cpu", 1}};
    budget.stages = {stage("capture", capture_ms), stage("detect", detect_ms, "gpu"),
                     stage("policy", policy_ms, "cpu"), stage("actuate", actuate_ms)};
  }

  TrialResult run(core::Policy& policy) {
    BoxRenderer renderer({{{19.0, 9.0, 0.0}, {20.0, 11.0, 2.0}, 4, 1}});
    return run_trial({.episode = episode_,
                      .options = options_,
                      .world = world_,
                      .robot = robot_,
                      .renderer = renderer,
                      .detector = detector_,
                      .policy = policy,
                      .drive = drive_});
  }
  TrialResult run(const NotingPolicy::Answer& answer) {
    NotingPolicy policy(answer);
    return run(policy);
  }

  RobotModel robot_ = RobotModel::jackal_gentle();
  World world_;
  TrialOptions options_;
  Episode episode_;
  SlowDetector detector_;
  ExternalDrive* drive_ = nullptr;
};

inline void expect_same_ticks(const TrialResult& a, const TrialResult& b) {
  ASSERT_EQ(a.track.size(), b.track.size());
  for (std::size_t k = 0; k < a.track.size(); ++k) {
    ASSERT_EQ(a.track[k].pose.x_m, b.track[k].pose.x_m) << "tick " << k;
    ASSERT_EQ(a.track[k].pose.y_m, b.track[k].pose.y_m) << "tick " << k;
    ASSERT_EQ(a.track[k].pose.yaw_rad, b.track[k].pose.yaw_rad) << "tick " << k;
    ASSERT_EQ(a.track[k].command.forward_mps, b.track[k].command.forward_mps) << "tick " << k;
    ASSERT_EQ(a.track[k].command.turn_radps, b.track[k].command.turn_radps) << "tick " << k;
    ASSERT_EQ(a.track[k].capture_index, b.track[k].capture_index) << "tick " << k;
    ASSERT_EQ(a.track[k].state_hash, b.track[k].state_hash) << "tick " << k;
  }
  EXPECT_EQ(a.state_hash, b.state_hash);
  EXPECT_EQ(a.path_m, b.path_m);
  EXPECT_EQ(a.outcome, b.outcome);
}

}  // namespace segsim::sim
