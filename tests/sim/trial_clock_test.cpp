// Trials in virtual and measured time: what late perception does to a robot.
#include <cmath>
#include <functional>
#include <memory>
#include <thread>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "sim/trial.h"
#include "tests/sim/box_renderer.h"
#include "tests/sim/rooms.h"

namespace segsim::sim {
namespace {

constexpr core::TimeNs kMs = 1'000'000;

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

core::Decision command(double forward_mps, double turn_radps) {
  return {{forward_mps, turn_radps}, core::PolicyMode::kExplore, false, {}};
}

/// Weaves, so that every tick matters.
core::Decision weave(const core::Observation& seen) {
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

StageBudget stage(const std::string& name, double ms, const std::string& on = "") {
  StageBudget made;
  made.name = name;
  made.on = on;
  made.duration.a_ms = ms;
  return made;
}

class TrialClockTest : public testing::Test {
 protected:
  TrialClockTest() : world_(World::from_mesh(make_room(20.0F, 20.0F), robot_)) {
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
    return run_trial(episode_, options_, world_, robot_, renderer, detector_, policy, nullptr);
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
};

void expect_same_ticks(const TrialResult& a, const TrialResult& b) {
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

TEST_F(TrialClockTest, VirtualTimeWithoutLatenciesIsLockstepTickForTick) {
  const TrialResult lockstep = run(weave);
  play(0, 0, 0, 0);
  const TrialResult virtual_time = run(weave);
  ASSERT_GT(lockstep.path_m, 2.0);
  expect_same_ticks(lockstep, virtual_time);
  EXPECT_EQ(virtual_time.timing.age.max(), 0);
  EXPECT_EQ(virtual_time.timing.ticks_without_news, 0);
  // With a latency they differ.
  play(0, 0, 0, 5);
  EXPECT_NE(run(weave).state_hash, lockstep.state_hash);
}

TEST_F(TrialClockTest, AnEqualTrialIsEqual) {
  play(33, 80, 4, 8);
  options_.clock.budget.stages[1].duration.kind = DurationModel::Kind::kLognormal;
  options_.clock.budget.stages[1].duration.b_ms = 120;
  options_.clock.camera = {70 * kMs, 5 * kMs, 10 * kMs};
  const TrialResult first = run(weave);
  expect_same_ticks(first, run(weave));
  episode_.seed = 43;
  EXPECT_NE(run(weave).state_hash, first.state_hash);
}

TEST_F(TrialClockTest, TwoHundredMillisecondsOnDetectAreTwoHundredOfAge) {
  play(33, 30, 4, 8);
  const core::TimeNs tick_ns = std::llround(options_.control_period_s * 1e9);
  LatencyBudget& budget = options_.clock.budget;
  const auto rise_ns = [&](int servers) {
    budget.resources["gpu"] = servers;
    budget.find("detect")->duration.added_ms = 0;
    const TrialResult before = run(weave);
    EXPECT_EQ(before.timing.age.percentile(0.5), 100 * kMs) << "33 + 30 ms, so the next tick";
    budget.find("detect")->duration.added_ms = 200;
    const TrialResult after = run(weave);
    EXPECT_EQ(after.timing.find("detect")->drops > 10, servers == 1);
    if (servers == 1) {
      EXPECT_NEAR(after.timing.utilisation("gpu"), 1.0, 0.05);
    }
    return after.timing.age.percentile(0.5) - before.timing.age.percentile(0.5);
  };
  // Three images at a time: nothing waits, so the delay is all there is.
  EXPECT_NEAR(static_cast<double>(rise_ns(3)), 200.0 * kMs, static_cast<double>(tick_ns));
  // One at a time: images wait for the server, and each is in use for longer.
  const core::TimeNs alone_ns = rise_ns(1);
  EXPECT_GE(alone_ns, 200 * kMs);
  EXPECT_LE(alone_ns, 200 * kMs + 2 * tick_ns);
}

TEST_F(TrialClockTest, TheWorkedTimelineOfTheDesignHoldsInATrial) {
  play(33, 80, 0, 0);
  LatencyBudget& budget = options_.clock.budget;
  budget.stages.push_back(stage("segment", 25, "gpu"));
  budget.stages.back().after = {"detect"};
  budget.stages.push_back(stage("map", 10, "gpu"));
  budget.stages.back().after = {"segment"};
  options_.control_period_s = 0.05;
  options_.time_limit_s = 0.6;
  const TrialResult result = run(weave);
  const std::vector<std::int64_t> captures_ms = {-50, -50, -50, 0,   0,   0,  100,
                                                 100, 200, 200, 300, 300, 300};
  ASSERT_EQ(result.track.size(), captures_ms.size());
  for (std::size_t k = 0; k < captures_ms.size(); ++k) {
    EXPECT_EQ(result.track[k].capture_index * 50, captures_ms[k]) << 50 * k << " ms";
    if (captures_ms[k] < 0) continue;
    const auto age_ms = static_cast<std::int64_t>(50 * k) - captures_ms[k];
    EXPECT_EQ(result.track[k].age_ns, age_ms * kMs) << 50 * k << " ms";
  }
  EXPECT_EQ(result.timing.ticks_without_image, 3);
}

TEST_F(TrialClockTest, ACommandTakesEffectBetweenTicks) {
  // Tick 0: full speed, due at 37 ms. 2 m/s^2 for the 63 ms that are left of the tick.
  play(0, 0, 12, 25);
  robot_.max_acceleration_mps2 = 2.0;
  options_.time_limit_s = 0.1;
  const TrialResult result = run([](const auto&) { return command(0.8, 0.0); });
  // Velocity changes at the beginning of a substep: the first lasts 3 ms, then 12 of 5 ms.
  double v = 0.0, way_m = 0.0;
  for (int k = 0; k < 13; ++k) {
    const double h = k == 0 ? 0.003 : 0.005;
    v += 2.0 * h;
    way_m += v * h;
  }
  EXPECT_NEAR(result.path_m, way_m, 1e-12);
  EXPECT_EQ(result.timing.end_to_end.response.max(), 37 * kMs);
}

TEST_F(TrialClockTest, MeasuredTimesPlayedAsATraceGiveTheSameTrial) {
  options_.clock.mode = ClockMode::kMeasured;
  options_.clock.measured_scale = 40.0;
  options_.time_limit_s = 4.0;
  const TrialResult measured = run(weave);
  EXPECT_GE(measured.timing.find("detect")->response.percentile(0.0), 40 * kMs)
      << "1 ms, forty times";
  ASSERT_TRUE(measured.trace.has("detect"));
  ASSERT_TRUE(measured.trace.has("policy"));

  TrialClock replay;
  replay.mode = ClockMode::kVirtual;
  replay.budget = with_trace(options_.clock.played_budget(),
                             std::make_shared<LatencyTrace>(measured.trace));
  options_.clock = replay;
  const TrialResult again = run(weave);
  expect_same_ticks(measured, again);
  EXPECT_EQ(again.trace, measured.trace);
}

TEST_F(TrialClockTest, TimePerDetectionIsCharged) {
  play(0, 10, 0, 0);
  options_.clock.budget.stages.push_back(stage("segment", 1, "gpu"));
  options_.clock.budget.stages.back().after = {"detect"};
  options_.clock.budget.stages.back().duration.per_item_ms = 6;
  detector_.found_ = 3;
  EXPECT_EQ(run(weave).timing.find("segment")->response.max(), 19 * kMs);
}

// A label at 3 m, placed with the pose of the tick, is off by 2 r sin(w age / 2).
TEST_F(TrialClockTest, RegistrationAtUseMovesLabelsByTheFormula) {
  play(0, 150, 0, 0);
  options_.clock.budget.find("detect")->on = "";  // No queue: each image is 150 ms late.
  const auto turn = [](const core::Observation&) { return command(0.0, 1.0); };
  for (const Registration registration : {Registration::kCapture, Registration::kUse}) {
    options_.clock.registration = registration;
    NotingPolicy policy(turn);
    const TrialResult result = run(policy);
    std::size_t decided = 0;
    for (std::size_t k = 0; k < result.track.size(); ++k) {
      const TickRecord& tick = result.track[k];
      if (!tick.fresh) continue;
      const core::Pose2 shown = policy.poses_[decided++];
      if (k < 20) continue;  // Until the turn is steady.
      const core::TimeNs capture_ns = tick.time_ns - tick.age_ns;
      const core::Pose2 then =
          result.track[static_cast<std::size_t>(capture_ns / (100 * kMs))].pose;
      const auto label = [](const core::Pose2& p) {
        return glm::dvec2(p.x_m + 3.0 * std::cos(p.yaw_rad),
                          p.y_m + 3.0 * std::sin(p.yaw_rad));
      };
      const double off_m = glm::distance(label(shown), label(then));
      const double expected_m = registration == Registration::kCapture
                                    ? 0.0
                                    : 6.0 * std::sin(0.5 * core::seconds(tick.age_ns));
      ASSERT_NEAR(off_m, expected_m, 1e-6) << "tick " << k;
      EXPECT_EQ(tick.age_ns, 200 * kMs);
    }
    EXPECT_GT(decided, 30U);
  }
  EXPECT_NEAR(6.0 * std::sin(0.1), 0.599, 5e-4) << "the figure of the design notes";
}

TEST_F(TrialClockTest, WhatALateCommandLeadsTo) {
  const auto ahead = [](const core::Observation&) { return command(0.5, 0.0); };
  play(0, 0, 0, 30);
  options_.clock.budget.end_to_end_deadline_ns = 30 * kMs;
  options_.time_limit_s = 2.0;
  const TrialResult in_time = run(ahead);
  EXPECT_EQ(in_time.timing.end_to_end.misses, 0) << "at the deadline is in time";

  options_.clock.budget.end_to_end_deadline_ns = 29 * kMs;
  LatencyBudget& budget = options_.clock.budget;
  budget.on_miss = OnMiss::kUseStale;
  const TrialResult stale = run(ahead);
  expect_same_ticks(stale, in_time);
  EXPECT_EQ(stale.timing.end_to_end.misses, stale.timing.end_to_end.response.count());
  EXPECT_EQ(stale.timing.end_to_end.longest_miss_run, stale.timing.end_to_end.misses);
  for (const OnMiss rule : {OnMiss::kDrop, OnMiss::kHold, OnMiss::kZeroCommand}) {
    budget.on_miss = rule;
    const TrialResult result = run(ahead);
    EXPECT_EQ(result.path_m, 0.0) << to_string(rule);
    EXPECT_EQ(result.outcome, Outcome::kTimeout);
    EXPECT_EQ(result.timing.end_to_end.misses, stale.timing.end_to_end.misses);
  }
  budget.on_miss = OnMiss::kAbort;
  const TrialResult aborted = run(ahead);
  EXPECT_EQ(aborted.outcome, Outcome::kAborted);
  EXPECT_NEAR(aborted.sim_s, 0.03, 1e-9);
}

/// Late from the 5th image on: the last command in time was half speed ahead.
TEST_F(TrialClockTest, HoldGoesOnDropRunsIntoTheTimeoutZeroStops) {
  play(0, 0, 0, 0);
  auto trace = std::make_shared<LatencyTrace>();
  for (std::uint64_t tick = 0; tick < 30; ++tick) {
    trace->add("actuate", tick, tick < 5 ? 0 : 40 * kMs);
  }
  LatencyBudget& budget = options_.clock.budget;
  budget = with_trace(budget, trace);
  budget.end_to_end_deadline_ns = 20 * kMs;
  options_.time_limit_s = 2.9;
  const auto way_m = [&](OnMiss rule) {
    budget.on_miss = rule;
    return run([](const auto&) { return command(0.5, 0.0); }).path_m;
  };
  const double held_m = way_m(OnMiss::kHold);
  const double dropped_m = way_m(OnMiss::kDrop);
  const double stopped_m = way_m(OnMiss::kZeroCommand);
  EXPECT_NEAR(held_m, 0.5 * 2.9 - 0.5 * 0.5 * 0.25, 0.01) << "at speed after 0.25 s";
  // The last command is of 0.4 s. Stopped from 0.54 s on, or 0.25 s after 0.4 s.
  EXPECT_NEAR(stopped_m, 0.5 * 0.54 - 0.0625 + 0.0625, 0.01);
  EXPECT_NEAR(dropped_m, 0.5 * 0.65 - 0.0625 + 0.0625, 0.01);
}

TEST_F(TrialClockTest, ImagesThatAreTooOldStopTheRobot) {
  play(0, 350, 0, 0);
  options_.clock.budget.max_age_ns = 300 * kMs;
  options_.time_limit_s = 3.0;
  const auto ahead = [](const core::Observation&) { return command(0.5, 0.0); };
  options_.clock.budget.on_max_age = OnMiss::kZeroCommand;
  EXPECT_EQ(run(ahead).path_m, 0.0);
  options_.clock.budget.on_max_age = OnMiss::kUseStale;
  EXPECT_GT(run(ahead).path_m, 0.5);
  options_.clock.budget.on_max_age = OnMiss::kAbort;
  EXPECT_EQ(run(ahead).outcome, Outcome::kAborted);
}

TEST_F(TrialClockTest, AStopIsJudgedWhereTheRobotIsWhenItTakesEffect) {
  episode_.start = {10.0, 10.0, 0.0};
  episode_.view_points_m = {{12.0, 10.0}};
  options_.require_visible = false;
  options_.success_distance_m = 0.5;
  // STOP is decided on the image of 10.9 m ...
  const auto until = [](const core::Observation& seen) {
    core::Decision decision = command(0.8, 0.0);
    decision.stop = seen.T_odom_robot.translation_m().x > 10.9;
    if (decision.stop) decision.stop_reason = "goal_reached";
    return decision;
  };
  EXPECT_EQ(run(until).outcome, Outcome::kStoppedFar);
  // ... and a second later the robot has come near.
  play(0, 0, 1000, 0);
  const TrialResult late = run(until);
  EXPECT_EQ(late.outcome, Outcome::kSuccess);
  EXPECT_LT(late.distance_to_goal_m, 0.5);
}

TEST_F(TrialClockTest, TheEndIsWhereTheStopTookEffectNotWhereItWasDecided) {
  episode_.start = {10.0, 10.0, 0.0};
  episode_.view_points_m = {{12.0, 10.0}};
  const auto until = [](const core::Observation& seen) {
    core::Decision decision = command(0.8, 0.0);
    decision.stop = seen.T_odom_robot.translation_m().x > 10.9;
    if (decision.stop) decision.stop_reason = "goal_reached";
    return decision;
  };
  play(0, 0, 1000, 0);
  const TrialResult late = run(until);
  // A second at full speed: the base does not run into its command timeout of 0.25 s, since
  // the last command is sent again until the STOP is due.
  EXPECT_NEAR(late.final_pose.x_m - late.track.back().pose.x_m, 0.8, 1e-6);
  EXPECT_NEAR(late.sim_s - core::seconds(late.track.back().time_ns), 1.0, 1e-9);
  EXPECT_NEAR(glm::distance(glm::dvec2(late.final_pose.x_m, late.final_pose.y_m),
                            episode_.view_points_m[0]),
              late.distance_to_goal_m, 0.03);
  // Without latency they are the same.
  play(0, 0, 0, 0);
  const TrialResult at_once = run(until);
  EXPECT_EQ(at_once.final_pose.x_m, at_once.track.back().pose.x_m);
}

TEST_F(TrialClockTest, AnImageTooOldStopsTheRobotAlsoWhileItsStopIsOnTheWay) {
  const auto until = [](const core::Observation& seen) {
    core::Decision decision = command(0.8, 0.0);
    decision.stop = core::seconds(seen.capture_time_ns) > 1.0;
    if (decision.stop) decision.stop_reason = "goal_reached";
    return decision;
  };
  // Only the decision to stop, of tick 11, takes a second.
  play(0, 0, 0, 0);
  auto trace = std::make_shared<LatencyTrace>();
  for (std::uint64_t tick = 0; tick < 12; ++tick) {
    trace->add("policy", tick, tick < 11 ? 0 : 1000 * kMs);
  }
  options_.clock.budget = with_trace(options_.clock.budget, trace);
  const TrialResult rolls = run(until);
  options_.clock.budget.max_age_ns = 500 * kMs;
  options_.clock.budget.on_max_age = OnMiss::kZeroCommand;
  // Stopped at 1.7 s instead of 2.1 s, with 2 m/s^2.
  EXPECT_NEAR(rolls.path_m - run(until).path_m, 0.8 * 0.4 - 0.16, 0.01);
}

/// Without a capture latency, images arrive at the very moment at which a server of 50 ms jobs
/// becomes free. It takes the newest, so nothing waits.
TEST_F(TrialClockTest, AServerThatBecomesFreeTakesTheImageOfThatMoment) {
  play(0, 100, 0, 0);
  options_.control_period_s = 0.05;
  options_.time_limit_s = 2.0;
  const TrialResult result = run(weave);
  for (const TickRecord& tick : result.track) {
    if (tick.capture_index < 0) continue;
    // 0 at 100, 100 at 200, ...: the image between is displaced by that of the moment.
    ASSERT_EQ(tick.capture_index % 2, 0) << tick.time_ns / kMs << " ms";
    EXPECT_EQ(tick.age_ns, (tick.time_ns / kMs % 100 == 0 ? 100 : 150) * kMs);
  }
  EXPECT_EQ(result.timing.find("detect")->response.max(), 100 * kMs) << "no image waited";
}

TEST_F(TrialClockTest, AStageIsSlowerWhileAFaultLasts) {
  play(0, 30, 0, 0);
  options_.control_period_s = 0.05;
  options_.time_limit_s = 4.0;
  options_.faults.latencies = {{"detect", 1000 * kMs, 2000 * kMs, 200 * kMs}};
  const TrialResult result = run(weave);
  for (const TickRecord& tick : result.track) {
    const core::TimeNs t = tick.time_ns / kMs;
    if (t >= 100 && t <= 1000) {
      ASSERT_EQ(tick.age_ns, 50 * kMs) << t << " ms";
    }
    if (t >= 1300 && t < 2200) {
      ASSERT_GE(tick.age_ns, 250 * kMs) << t << " ms";
    }
    if (t >= 2400) {
      ASSERT_EQ(tick.age_ns, 50 * kMs) << t << " ms";
    }
  }
  EXPECT_GE(result.timing.find("detect")->response.max(), 230 * kMs) << "images wait, too";
}

TEST_F(TrialClockTest, DroppedFramesAreMissingAndShiftNoOther) {
  options_.time_limit_s = 3.0;
  options_.clock.camera = {100 * kMs, 0, 20 * kMs};
  play(0, 0, 0, 0);
  const TrialResult whole = run(weave);
  options_.faults.frame_drops = {{1000 * kMs, 6}};
  const TrialResult result = run(weave);
  EXPECT_EQ(result.frames_dropped, 6);
  EXPECT_EQ(result.timing.age.max() / (100 * kMs), 6);
  ASSERT_EQ(result.track.size(), whole.track.size());
  // The camera's jitter is keyed by the image's number, so later images are those of before.
  EXPECT_EQ(result.track.back().capture_index, whole.track.back().capture_index);
  EXPECT_EQ(result.track.back().age_ns, whole.track.back().age_ns);
}

TEST_F(TrialClockTest, ASlowCameraIsAskedOnlyWhenItSamples) {
  options_.clock.camera = {300 * kMs, 0, 0};
  options_.time_limit_s = 3.0;
  NotingPolicy policy(weave);
  const TrialResult result = run(policy);
  EXPECT_EQ(policy.poses_.size(), 11U) << "0, 0.3, ..., 3.0 s";
  EXPECT_EQ(result.ticks, 31);
  EXPECT_EQ(result.timing.ticks_without_news, 20);
  EXPECT_GT(result.path_m, 0.5) << "between images the last command holds";
}

TEST_F(TrialClockTest, ContactsAreRecorded) {
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

TEST_F(TrialClockTest, WithOdometryThePolicySeesAnEstimate) {
  options_.odometry = OdometryNoise::skid_steered_indoors();
  NotingPolicy policy(weave);
  const TrialResult result = run(policy);
  const core::Pose2 truth = result.track.back().pose, told = policy.poses_.back();
  const double off_m = std::hypot(told.x_m - truth.x_m, told.y_m - truth.y_m);
  EXPECT_GT(off_m, 1e-4);
  EXPECT_LT(off_m, 1.0);
  EXPECT_NEAR(result.final_estimate.x_m, told.x_m, 1e-12) << "the last tick is the end";
  EXPECT_EQ(policy.poses_.front().x_m, episode_.start.x_m);
  // Commands do not depend on the pose here, so the true way is the one without odometry.
  options_.odometry.reset();
  EXPECT_EQ(run(weave).path_m, result.path_m);
}

TEST_F(TrialClockTest, ABaseThatSlidesGetsFartherThanOneThatStops) {
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
TEST_F(TrialClockTest, TurningBesideAWallCollidesForAFootprintButNotOnTheNavmesh) {
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

TEST_F(TrialClockTest, OnTheNavmeshARobotStopsAtTheEdgeOrSlidesAlongIt) {
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

TEST_F(TrialClockTest, RealTimeTakesItsTime) {
  options_.clock.mode = ClockMode::kRealtime;
  options_.time_limit_s = 0.5;
  const TrialResult result = run(weave);
  EXPECT_GE(result.wall_s, 0.49);
  EXPECT_GT(result.timing.age.max(), 0);
}

}  // namespace
}  // namespace segsim::sim
