#pragma once

/// @file
/// "Success" is not one thing: each evaluation has a rule of its own, and rates under
/// different rules do not compare. A profile is a rule with a name that stands beside every
/// rate.
///
///     segsim-object      found STOP, d < 1 m, a goal object in view   (ours)
///     habitat-hm3d       STOP, d < 0.1 m       habitat-lab 0fb6f43, objectnav.yaml, nav.py
///     apexnav            STOP, d < 0.2 m       ApexNav, habitat_eval configuration
///     semexp-gibson      STOP within 1 m (along the floor) of the object
///                                              SemExp 5d76902, envs/habitat/objectgoal_env.py
///     allenact-robothor  STOP with an object of the class in view
///                                              allenact d055fc9, robothor_tasks.py
///     barn               within 1 m of the goal, no contact, 100 s
///                                              the-barn-challenge bf5a226, run.py
///
/// A found STOP is one of a policy that says that it reached its goal.
/// The rules of others count a STOP for any reason, also of a policy that gives up: that is
/// what their programs see. d: geodesic distance to the nearest view point. "Below" is strict
/// everywhere but in barn.

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace segsim::sim {

/// What a trial ended with: all that a rule may ask for.
struct TrialEnd {
  bool stopped = false;   ///< The policy called STOP, for whatever reason.
  bool declared = false;  ///< And the reason was that it had reached its goal.
  double view_point_m = std::numeric_limits<double>::infinity();  ///< d.
  /// Geodesic to the nearest place within 1 m (in plan) of a goal object; 0 there.
  double object_m = std::numeric_limits<double>::infinity();
  /// Straight in plan to the nearest view point.
  double planar_m = std::numeric_limits<double>::infinity();
  int visible_px = 0;  ///< Of the goal object that is seen best, in the last image.
  int contacts = 0;
  double time_s = 0.0;
  double path_m = 0.0;             ///< p.
  double shortest_path_m = 0.0;    ///< l: from the start to the nearest view point.
  double shortest_object_m = 0.0;  ///< `object_m` at the start.
};

enum class SuccessRule : std::uint8_t { kViewPoint, kObjectArea, kInView, kGoalPosition };

struct SuccessProfile {
  std::string name = "segsim-object";
  SuccessRule rule = SuccessRule::kViewPoint;
  double distance_m = 1.0;      ///< kViewPoint, kGoalPosition.
  bool require_visible = true;  ///< kViewPoint: besides the distance.
  int visible_px = 40;          ///< From so many pixels of one goal object on it is in view.
  double time_limit_s = std::numeric_limits<double>::infinity();  ///< kGoalPosition.
  bool any_stop = false;  ///< Whether a policy that gives up can succeed by where it stands.

  bool operator==(const SuccessProfile&) const = default;
};

/// All named profiles, "segsim-object" first.
[[nodiscard]] const std::vector<SuccessProfile>& success_profiles();
/// nullptr if there is none of that name.
[[nodiscard]] const SuccessProfile* find_success_profile(const std::string& name);
/// The rule in one sentence without a full stop, with its numbers.
[[nodiscard]] std::string in_words(const SuccessProfile& profile);

[[nodiscard]] bool succeeded(const SuccessProfile& profile, const TrialEnd& end);

/// SPL as the profile's authors compute it: S l / max(l, p), but semexp-gibson
/// min(S (shortest_object_m + 1) / p, 1) with p >= 1e-5, and barn the score below.
[[nodiscard]] double profile_spl(const SuccessProfile& profile, const TrialEnd& end);

/// BARN: S OT / clip(t, 2 OT, 8 OT) with OT = path / (2 m/s).
[[nodiscard]] double barn_score(bool success, double shortest_path_m, double time_s);

}  // namespace segsim::sim
