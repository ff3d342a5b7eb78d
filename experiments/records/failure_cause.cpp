#include "experiments/records/failure_cause.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/name_table.h"
#include "nav/motion/stuck_detector.h"

namespace segsim::experiments::records {
namespace {

/// A trial of whose images more than this is holes says little about perception or policy.
constexpr double kMostInvalid = 0.5;

struct CauseWords {
  const char* name;
  const char* words;
};
constexpr std::array<CauseWords, kCauses> kWords{{
    {"did_not_fail", "the goal was found"},
    {"false_positive", "it took something else for the goal"},
    {"bad_stop_true_positive",
     "it went for a true goal, but stopped too far from it or without seeing it"},
    {"timeout_true_positive", "time ran out on the way to a true goal"},
    {"false_negative", "the goal was in view, but the detector never reported it"},
    {"detected_not_pursued",
     "the detector reported the goal, but the policy did not go there"},
    {"never_saw_target", "time ran out before the goal came into view"},
    {"no_frontier_left",
     "the policy had nothing left to explore, and the goal never was in view"},
    {"stuck", "the robot could not move on"},
    {"map_exhausted", "the robot came to the edge of its map"},
    {"pointnav_stop", "the local policy stopped while it explored"},
    {"collision_abort", "a contact ended the trial"},
    {"deadline_abort", "a missed deadline ended the trial"},
    {"gave_up", "the policy stopped for a reason of its own"},
    {"render_invalid",
     "the goal never was in view, and most of what the camera saw were holes in the "
     "reconstruction"},
    {"harness_error", "the harness failed"},
    {"infeasible", "there is no way from the start to the goal for this robot"},
    {"trivial", "the start is a view point already"},
}};

constexpr std::array<const char*, kCauses> names_only() {
  std::array<const char*, kCauses> names{};
  for (std::size_t k = 0; k < names.size(); ++k) names[k] = kWords[k].name;
  return names;
}
constexpr core::NameTable<Cause, Cause::kTrivial> kNames("a failure cause", names_only());

int last_tick(const FailureFacts& facts) { return static_cast<int>(facts.track.size()) - 1; }

/// The beginning of the last stretch of driving to an object; -1 if there is none.
int last_drive_began(std::span<const sim::TickRecord> track) {
  int tick = static_cast<int>(track.size()) - 1;
  while (tick >= 0 &&
         track[static_cast<std::size_t>(tick)].mode != core::PolicyMode::kNavigate) {
    --tick;
  }
  while (tick > 0 &&
         track[static_cast<std::size_t>(tick) - 1].mode == core::PolicyMode::kNavigate) {
    --tick;
  }
  return tick;
}

template <class Holds>
int first_tick(std::span<const TickEvidence> evidence, const Holds& holds) {
  const auto found = std::find_if(evidence.begin(), evidence.end(), holds);
  return found == evidence.end() ? -1 : static_cast<int>(found - evidence.begin());
}

/// Motion was commanded to the end, and nothing moved, by the limits of the search policies.
bool stood_still(std::span<const sim::TickRecord> track) {
  const nav::StuckOptions limits;
  const auto ticks = static_cast<std::size_t>(limits.decisions);
  if (track.size() <= ticks) return false;
  const auto tail = track.last(ticks + 1);
  const core::Pose2 &a = tail.front().pose, &b = tail.back().pose;
  if (std::hypot(b.x_m - a.x_m, b.y_m - a.y_m) >= limits.distance_m ||
      std::abs(core::wrap_angle_rad(b.yaw_rad - a.yaw_rad)) >= limits.turn_rad) {
    return false;
  }
  return std::all_of(tail.begin(), tail.end() - 1, [](const sim::TickRecord& tick) {
    return tick.command.forward_mps != 0.0 || tick.command.turn_radps != 0.0;
  });
}

/// The first tick from which no drive within the robot's limits could be in time.
int too_late_from(const FailureFacts& facts) {
  for (std::size_t k = 0; k < facts.distance_m.size() && k < facts.track.size(); ++k) {
    if (!std::isfinite(facts.distance_m[k])) continue;
    const double left_s = facts.time_limit_s - core::seconds(facts.track[k].time_ns);
    if (facts.distance_m[k] - facts.success_distance_m > facts.max_speed_mps * left_s) {
      return static_cast<int>(k);
    }
  }
  return last_tick(facts);
}

/// Among the trials that never got to a goal: what perception had to do with it.
Verdict judge_search(const FailureFacts& facts, Cause unseen) {
  const int visible = first_tick(
      facts.evidence, [&](const TickEvidence& e) { return e.largest_px >= facts.visible_px; });
  const int detected =
      first_tick(facts.evidence, [](const TickEvidence& e) { return e.true_detections > 0; });
  if (detected >= 0) return {Cause::kDetectedNotPursued, -1, detected};
  if (visible >= 0) return {Cause::kFalseNegative, -1, visible};
  // Holes may have hidden the goal, and what the policy explored was no room.
  if (facts.invalid_pixel_fraction > kMostInvalid) unseen = Cause::kRenderInvalid;
  return {unseen, -1, -1};
}

Verdict judge_give_up(const FailureFacts& facts) {
  using enum core::StopReason;
  if (!facts.stop_reason) return {Cause::kGaveUp, -1, -1};
  switch (*facts.stop_reason) {
    case kStuck:
      return {Cause::kStuck, -1, -1};
    case kMapExhausted:
      return {Cause::kMapExhausted, -1, -1};
    case kPointnavStop:
      return {Cause::kPointnavStop, -1, -1};
    case kNoFrontierLeft:
    case kNothingNew:  // It went in circles.
      return judge_search(facts, Cause::kNoFrontierLeft);
    case kGoalReached:
    case kNoPath:
    case kRandomStop:
    case kScriptEnd:
    case kStepFailed:
      break;
  }
  return {Cause::kGaveUp, -1, -1};
}

Verdict judge_timeout(const FailureFacts& facts) {
  Verdict verdict;
  if (stood_still(facts.track)) {
    verdict.cause = Cause::kStuck;
  } else if (!facts.track.empty() && facts.track.back().mode == core::PolicyMode::kNavigate &&
             facts.target_m) {
    verdict.cause = facts.target_is_goal ? Cause::kTimeoutTruePositive : Cause::kFalsePositive;
    verdict.decisive_tick = last_drive_began(facts.track);
  } else {
    verdict = judge_search(facts, Cause::kNeverSawTarget);
  }
  verdict.inevitable_tick = too_late_from(facts);
  return verdict;
}

Verdict judge_stop(const FailureFacts& facts) {
  bool true_target = facts.target_is_goal;
  if (!facts.target_m) {
    // A policy that does not say what it went for: then what it saw last decides.
    true_target =
        !facts.evidence.empty() && (facts.evidence.back().true_detections > 0 ||
                                    facts.evidence.back().largest_px >= facts.visible_px);
  }
  return {true_target ? Cause::kBadStopTruePositive : Cause::kFalsePositive, -1,
          last_drive_began(facts.track)};
}

}  // namespace

const char* to_string(Cause cause) { return kNames.name(cause); }
std::optional<Cause> find_cause(std::string_view name) { return kNames.find(name); }
Cause cause_from(std::string_view name, const std::string& place) {
  return kNames.read(name, place);
}
const char* in_words(Cause cause) { return kWords[static_cast<std::size_t>(cause)].words; }

Verdict judge(const FailureFacts& facts) {
  if (facts.outcome == sim::Outcome::kSuccess) return {};
  Verdict verdict;
  if (facts.outcome == sim::Outcome::kCollision) {
    verdict.cause = Cause::kCollisionAbort;
  } else if (facts.outcome == sim::Outcome::kTimeout) {
    return judge_timeout(facts);
  } else if (facts.outcome == sim::Outcome::kGaveUp) {
    verdict = judge_give_up(facts);
  } else if (facts.outcome == sim::Outcome::kStoppedFar ||
             facts.outcome == sim::Outcome::kNotVisible) {
    verdict = judge_stop(facts);
  } else {
    verdict.cause = Cause::kDeadlineAbort;  // Ended neither by the policy nor by the world.
  }
  verdict.inevitable_tick = last_tick(facts);
  return verdict;
}

double distance_to_goal_box_m(const core::SceneManifest& manifest,
                              const sim::GoalObjects& goal, const glm::dvec2& p_m) {
  double best_m = std::numeric_limits<double>::infinity();
  for (const core::SceneInstance& instance : manifest.instances) {
    if (!goal.holds(instance)) continue;
    const glm::dvec2 nearest =
        glm::clamp(p_m, glm::dvec2(instance.box_min_m), glm::dvec2(instance.box_max_m));
    best_m = std::min(best_m, glm::distance(p_m, nearest));
  }
  return best_m;
}

}  // namespace segsim::experiments::records
