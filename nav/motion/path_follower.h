#pragma once

/// @file
/// Pure pursuit (Coulter 1992), or a dynamic window (nav/motion/dwa_follower.h), for a
/// differential drive: turn in place when the path lies far off the heading, slow down near
/// obstacles and at the end, and never command a motion whose forward simulation enters a cell
/// known as occupied.

#include "core/frames.h"
#include "core/stages.h"
#include "nav/motion/dwa_follower.h"
#include "nav/motion/path_progress.h"
#include "nav/planning/cost_map.h"
#include "nav/planning/grid_planner.h"

namespace segsim::nav {

enum class LocalMotion : std::uint8_t { kPurePursuit, kDynamicWindow };

struct FollowerOptions {
  LocalMotion motion = LocalMotion::kPurePursuit;
  DwaOptions window = {};  ///< Of the dynamic window; its speed limits are those below.
  double max_forward_mps = 0.8;
  double max_turn_radps = 1.2;
  double max_accel_mps2 = 1.5;  ///< Assumed deceleration when slowing towards the goal.
  double lookahead_m = 0.45;
  double turn_in_place_above_rad =
      0.7;                       ///< Larger heading errors are turned away on the spot.
  double turn_gain_per_s = 2.5;  ///< Turn rate per heading error.
  double min_forward_mps = 0.08;
  double slow_clearance_m = 0.55;     ///< Below this clearance the speed falls linearly ...
  double min_clearance_factor = 0.4;  ///< ... to this share of the maximum at the footprint.
  double footprint_radius_m = 0.27;   ///< Circle checked against occupied cells; between the
                                     ///< inscribed and the circumscribed circle of the Jackal,
                                     ///< and below the planner's narrowest inflation.
  double horizon_s = 1.0;  ///< Forward simulation.
  double goal_tolerance_m = 0.12;
};

class PathFollower {
 public:
  explicit PathFollower(const FollowerOptions& options = {});

  /// Starts a new path.
  void set_path(const Path& path);
  void clear();
  [[nodiscard]] bool has_path() const { return !path_.points_m.empty(); }
  [[nodiscard]] const Path& path() const { return path_; }
  /// Whether the robot is within goal_tolerance_m of the path's end.
  [[nodiscard]] bool arrived(const core::Pose2& T_odom_robot) const;
  /// Command along the path; zero without one. `blocked()` tells whether the forward motion
  /// was taken away by the safety check.
  [[nodiscard]] core::VelocityCommand follow(const core::Pose2& T_odom_robot,
                                             const CostMap& map);
  /// Command that turns on the spot towards a heading; zero when within `tolerance_rad`.
  [[nodiscard]] core::VelocityCommand turn_to(const core::Pose2& T_odom_robot, double yaw_rad,
                                              double tolerance_rad = 0.05) const;
  [[nodiscard]] bool blocked() const { return blocked_; }
  /// Whether holding the command for horizon_s, then braking, keeps the footprint off occupied
  /// cells. A motion that leads out of a violated footprint is safe.
  [[nodiscard]] bool safe(const core::Pose2& T_odom_robot,
                          const core::VelocityCommand& command, const CostMap& map) const;

 private:
  FollowerOptions options_;
  DwaFollower window_;
  Path path_;
  PathProgress progress_;
  bool blocked_ = false;
};

/// Pose after holding the command for `dt_s` (exact arc).
[[nodiscard]] core::Pose2 advance(const core::Pose2& pose,
                                  const core::VelocityCommand& command, double dt_s);

}  // namespace segsim::nav
