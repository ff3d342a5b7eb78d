#include "experiments/records/failure_cause.h"

#include <limits>
#include <set>

#include <gtest/gtest.h>

#include "core/error.h"

namespace segsim::experiments {
namespace {

using core::PolicyMode;
using core::StopReason;

/// A trial made by hand: one tick per second, straight on at 0.5 m/s, the goal 20 m away.
class Trial {
 public:
  explicit Trial(int ticks, PolicyMode mode = PolicyMode::kExplore) {
    for (int k = 0; k < ticks; ++k) {
      sim::TickRecord tick;
      tick.time_ns = k * core::kNsPerSecond;
      tick.pose = {0.5 * k, 0.0, 0.0};
      tick.command = {0.5, 0.0};
      tick.mode = mode;
      track.push_back(tick);
      distance_m.push_back(20.0);
    }
    evidence.resize(track.size());
    facts.time_limit_s = ticks;
    facts.max_speed_mps = 1.0;
    facts.success_distance_m = 1.0;
  }
  Trial& outcome(sim::Outcome outcome, std::optional<StopReason> reason = {}) {
    facts.outcome = outcome;
    facts.stop_reason = reason;
    return *this;
  }
  Trial& modes(std::size_t from, PolicyMode mode) {
    for (std::size_t k = from; k < track.size(); ++k) track[k].mode = mode;
    return *this;
  }
  Trial& seen_at(std::size_t tick, int px) {
    evidence[tick].largest_px = px;
    return *this;
  }
  Trial& detected_at(std::size_t tick) {
    evidence[tick].true_detections = 1;
    return *this;
  }
  Trial& target(bool is_goal) {
    facts.target_m = glm::dvec2(9.0, 9.0);
    facts.target_is_goal = is_goal;
    return *this;
  }
  [[nodiscard]] records::Verdict verdict() {
    facts.track = track;
    facts.evidence = evidence;
    facts.distance_m = distance_m;
    return records::judge(facts);
  }

  std::vector<sim::TickRecord> track;
  std::vector<records::TickEvidence> evidence;
  std::vector<double> distance_m;
  records::FailureFacts facts;
};

void expect(const records::Verdict& verdict, records::Cause cause, int inevitable,
            int decisive) {
  EXPECT_STREQ(records::to_string(verdict.cause), records::to_string(cause));
  EXPECT_EQ(verdict.inevitable_tick, inevitable);
  EXPECT_EQ(verdict.decisive_tick, decisive);
}

TEST(FailureCause, ASuccessDidNotFail) {
  expect(Trial(30).outcome(sim::Outcome::kSuccess, StopReason::kGoalReached).verdict(),
         records::Cause::kDidNotFail, -1, -1);
}

TEST(FailureCause, StopAtSomethingElse) {
  Trial trial(30);
  trial.outcome(sim::Outcome::kStoppedFar, StopReason::kGoalReached)
      .modes(12, PolicyMode::kNavigate);
  trial.modes(29, PolicyMode::kStop).target(false);
  expect(trial.verdict(), records::Cause::kFalsePositive, 29, 12);
}

TEST(FailureCause, StopForATrueGoalTooFarOrLookingElsewhere) {
  for (const sim::Outcome outcome : {sim::Outcome::kStoppedFar, sim::Outcome::kNotVisible}) {
    Trial trial(30);
    trial.outcome(outcome, StopReason::kGoalReached)
        .modes(20, PolicyMode::kNavigate)
        .target(true);
    expect(trial.verdict(), records::Cause::kBadStopTruePositive, 29, 20);
  }
}

TEST(FailureCause, WithoutAKnownTargetTheLastImageDecides) {
  Trial blind(30), seeing(30);
  blind.outcome(sim::Outcome::kStoppedFar, StopReason::kGoalReached);
  expect(blind.verdict(), records::Cause::kFalsePositive, 29, -1);
  seeing.outcome(sim::Outcome::kStoppedFar, StopReason::kGoalReached).seen_at(29, 40);
  expect(seeing.verdict(), records::Cause::kBadStopTruePositive, 29, -1);
}

TEST(FailureCause, TimeOverOnTheWayToATrueOrFalseGoal) {
  Trial to_goal(30), astray(30);
  to_goal.modes(25, PolicyMode::kNavigate).target(true);
  // 20 m - 1 m at 1 m/s: too late once less than 19 s are left of 30, so from tick 12 on.
  expect(to_goal.verdict(), records::Cause::kTimeoutTruePositive, 12, 25);
  astray.modes(22, PolicyMode::kNavigate).target(false);
  expect(astray.verdict(), records::Cause::kFalsePositive, 12, 22);
}

TEST(FailureCause, TooLateIsWhenEvenTheStraightDriveIs) {
  Trial trial(30);
  for (std::size_t k = 0; k < 30; ++k) trial.distance_m[k] = 30.0 - static_cast<double>(k);
  // d_k - 1 = 29 - k < 30 - k: could always have made it; time itself ran out.
  EXPECT_EQ(trial.verdict().inevitable_tick, 29);
  trial.distance_m[5] = 27.0;  // 26 > 25
  EXPECT_EQ(trial.verdict().inevitable_tick, 5);
  trial.distance_m[5] = std::numeric_limits<double>::infinity();  // Off the floor: not known.
  EXPECT_EQ(trial.verdict().inevitable_tick, 29);
}

TEST(FailureCause, SeenAndNeverReported) {
  expect(Trial(30).seen_at(7, 40).verdict(), records::Cause::kFalseNegative, 12, 7);
  // One pixel less is not in view.
  expect(Trial(30).seen_at(7, 39).verdict(), records::Cause::kNeverSawTarget, 12, -1);
  Trial gave_up(30);
  gave_up.seen_at(9, 400).outcome(sim::Outcome::kGaveUp, StopReason::kNoFrontierLeft);
  expect(gave_up.verdict(), records::Cause::kFalseNegative, 29, 9);
}

TEST(FailureCause, ReportedAndNotFollowed) {
  Trial trial(30);
  trial.seen_at(7, 100).detected_at(8);
  expect(trial.verdict(), records::Cause::kDetectedNotPursued, 12, 8);
  trial.outcome(sim::Outcome::kGaveUp, StopReason::kNoFrontierLeft);
  expect(trial.verdict(), records::Cause::kDetectedNotPursued, 29, 8);
}

TEST(FailureCause, NothingLeftToExplore) {
  expect(Trial(30).outcome(sim::Outcome::kGaveUp, StopReason::kNoFrontierLeft).verdict(),
         records::Cause::kNoFrontierLeft, 29, -1);
}

TEST(FailureCause, ReasonsOfThePolicy) {
  const std::pair<StopReason, records::Cause> cases[] = {
      {StopReason::kStuck, records::Cause::kStuck},
      {StopReason::kMapExhausted, records::Cause::kMapExhausted},
      {StopReason::kPointnavStop, records::Cause::kPointnavStop},
      {StopReason::kNoPath, records::Cause::kGaveUp},
      {StopReason::kRandomStop, records::Cause::kGaveUp},
      {StopReason::kScriptEnd, records::Cause::kGaveUp}};
  for (const auto& [reason, cause] : cases) {
    Trial trial(30);
    // What was in view does not matter: the policy did not stop for it.
    trial.seen_at(3, 500).outcome(sim::Outcome::kGaveUp, reason);
    expect(trial.verdict(), cause, 29, -1);
  }
}

TEST(FailureCause, StandingStillToTheEndIsStuck) {
  Trial trial(40);
  for (std::size_t k = 19; k < 40; ++k) trial.track[k].pose = {9.5, 0.0, 0.0};
  expect(trial.verdict(), records::Cause::kStuck, 22, -1);
  Trial turning = trial;
  turning.track[39].pose.yaw_rad = 0.2;
  expect(turning.verdict(), records::Cause::kNeverSawTarget, 22, -1);
  Trial resting = trial;
  resting.track[30].command = {};
  expect(resting.verdict(), records::Cause::kNeverSawTarget, 22, -1);
}

TEST(FailureCause, CollisionAndHoles) {
  expect(Trial(30).outcome(sim::Outcome::kCollision).verdict(),
         records::Cause::kCollisionAbort, 29, -1);
  Trial holes(30);
  holes.facts.invalid_pixel_fraction = 0.51;
  expect(holes.verdict(), records::Cause::kRenderInvalid, 12, -1);
  holes.facts.invalid_pixel_fraction = 0.5;
  expect(holes.verdict(), records::Cause::kNeverSawTarget, 12, -1);
  holes.facts.invalid_pixel_fraction = 0.9;  // What was in view was not hidden.
  holes.seen_at(4, 60);
  expect(holes.verdict(), records::Cause::kFalseNegative, 12, 4);
}

TEST(FailureCause, NoTickIsNoCrash) {
  Trial nothing(0);
  expect(nothing.verdict(), records::Cause::kNeverSawTarget, -1, -1);
  nothing.outcome(sim::Outcome::kStoppedFar, StopReason::kGoalReached);
  expect(nothing.verdict(), records::Cause::kFalsePositive, -1, -1);
}

TEST(FailureCause, WordsAreUnique) {
  std::set<std::string> names, sentences;
  for (int k = 0; k < records::kCauses; ++k) {
    EXPECT_TRUE(names.insert(records::to_string(static_cast<records::Cause>(k))).second);
    EXPECT_TRUE(sentences.insert(records::in_words(static_cast<records::Cause>(k))).second);
  }
  EXPECT_EQ(names.count("harness_error"), 1U);
}

TEST(FailureCause, NamesAreReadBackAndNoOthers) {
  for (int k = 0; k < records::kCauses; ++k) {
    const auto cause = static_cast<records::Cause>(k);
    EXPECT_EQ(records::cause_from(records::to_string(cause), "here"), cause);
    EXPECT_EQ(records::find_cause(records::to_string(cause)), cause);
  }
  for (const char* wrong : {"", "success", "Stuck"}) {
    EXPECT_EQ(records::find_cause(wrong), std::nullopt);
    EXPECT_THROW((void)records::cause_from(wrong, "here"), core::InputError);
  }
}

TEST(FailureCause, DistanceToTheNearestGoalBox) {
  core::SceneManifest manifest;
  manifest.classes = {{1, "chair", true}, {2, "bed", true}};
  manifest.instances = {{1, 1, "a", {0, 0, 0}, {1, 1, 1}}, {2, 2, "b", {5, 0, 0}, {6, 1, 1}}};
  const sim::GoalObjects chairs(manifest, "chair"), beds(manifest, "bed"),
      desks(manifest, "desk");
  EXPECT_DOUBLE_EQ(records::distance_to_goal_box_m(manifest, chairs, {4.0, 5.0}), 5.0);
  EXPECT_DOUBLE_EQ(records::distance_to_goal_box_m(manifest, chairs, {0.5, 0.5}), 0.0);
  EXPECT_DOUBLE_EQ(records::distance_to_goal_box_m(manifest, beds, {4.0, 0.5}), 1.0);
  EXPECT_EQ(records::distance_to_goal_box_m(manifest, desks, {0, 0}),
            std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace segsim::experiments
