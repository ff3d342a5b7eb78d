#pragma once

/// @file
/// Why a trial failed: one cause each, found from what happened and from the ground truth,
/// never from what the policy says of itself. VLFM's taxonomy (bdaiinstitute/vlfm 584ed56,
/// utils/episode_stats_logger.py) where it has a word, ours beyond:
///
///     false_positive            stopped at, or time ran out on the way to, what is no goal
///
///     bad_stop_true_positive    stopped for a true goal, too far away or looking elsewhere
///
///     timeout_true_positive     time ran out on the way to a true goal
///
///     false_negative            the goal was in view, the detector never reported it
///
///     detected_not_pursued (+)  the detector reported it, the policy did not go there
///
///     never_saw_target          time ran out, the goal never was in view
///
///     no_frontier_left (+)      gave up, the goal never was in view
///
///     stuck (+)                 the policy says so, or commanded motion to the end in vain
///
///     map_exhausted, pointnav_stop, collision_abort, deadline_abort (+)
///
///     gave_up (+)               another reason to stop: no_path, random_stop, ...
///
///     render_invalid (+)        most of what the camera saw was a hole of the reconstruction
///
///     harness_error, infeasible, trivial (+)    no trial took place; in no rate
///
/// (+) ours. VLFM asks whether the explored area overlaps the goal's box; here "in view" is
/// read off the rendered labels. VLFM splits never_saw_target by stairs; a world here is one
/// floor.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <glm/vec2.hpp>

#include "core/scene_bundle.h"
#include "core/stop_reason.h"
#include "sim/trial/goal_objects.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::records {

enum class Cause : std::uint8_t {
  kDidNotFail,
  kFalsePositive,
  kBadStopTruePositive,
  kTimeoutTruePositive,
  kFalseNegative,
  kDetectedNotPursued,
  kNeverSawTarget,
  kNoFrontierLeft,
  kStuck,
  kMapExhausted,
  kPointnavStop,
  kCollisionAbort,
  kDeadlineAbort,
  kGaveUp,
  kRenderInvalid,
  kHarnessError,
  kInfeasible,
  kTrivial,
};
inline constexpr int kCauses = static_cast<int>(Cause::kTrivial) + 1;

/// The word of the table above; "did_not_fail" for successes.
[[nodiscard]] const char* to_string(Cause cause);
/// None if no cause has that name.
[[nodiscard]] std::optional<Cause> find_cause(std::string_view name);
/// @param place  Where the name was read, for the error message.
/// @throws core::InputError for a name that no cause has.
[[nodiscard]] Cause cause_from(std::string_view name, const std::string& place);
/// One sentence for people, without a full stop.
[[nodiscard]] const char* in_words(Cause cause);

/// What one image showed of the goal, by the labels; and what the detector said about it.
struct TickEvidence {
  int largest_px = 0;          ///< Of the goal instance seen best.
  std::uint16_t instance = 0;  ///< That one; 0 = none.
  int true_detections = 0, false_detections = 0;
};

/// Everything that decides. Spans: one entry per tick, borrowed.
struct FailureFacts {
  sim::Outcome outcome = sim::Outcome::kTimeout;
  std::optional<core::StopReason> stop_reason;
  std::span<const sim::TickRecord> track;
  std::span<const TickEvidence> evidence;
  /// Geodesic to the nearest view point; infinity off the free space. May be empty.
  std::span<const double> distance_m;
  /// What the policy drove to in the end, if it did; and whether a goal is there.
  std::optional<glm::dvec2> target_m;
  bool target_is_goal = false;
  int visible_px = 40;  ///< From so many pixels of one instance on the goal is in view.
  double time_limit_s = 0.0, max_speed_mps = 0.0, success_distance_m = 0.0;
  double invalid_pixel_fraction = 0.0;
};

struct Verdict {
  Cause cause = Cause::kDidNotFail;
  /// From this tick on the trial could not succeed any more; -1 if that cannot be said. When
  /// time ran out: the first tick at which even the straight drive at full speed would have
  /// come too late. When the policy stopped: its last tick, since until then it could have
  /// driven on.
  int inevitable_tick = -1;
  /// Where it went wrong: the beginning of the drive to the last target, the first missed view
  /// of the goal, the first detection that was not followed; -1 if there is no such tick.
  int decisive_tick = -1;
};

[[nodiscard]] Verdict judge(const FailureFacts& facts);

/// Distance in plan from a place to the nearest goal object's box; infinity without one.
[[nodiscard]] double distance_to_goal_box_m(const core::SceneManifest& manifest,
                                            const sim::GoalObjects& goal,
                                            const glm::dvec2& p_m);

}  // namespace segsim::experiments::records
