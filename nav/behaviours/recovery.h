#pragma once

/// @file
/// Getting free: when the robot is told to move and does not, it backs up a little and turns
/// by chance. What stopped it may be invisible to the camera, so the recovery also says which
/// disc ahead of the robot should count as an obstacle (SemExp's "bump rule"; VLFM has none).
///
///     watch -> due -> begin (felt disc) -> back -> turn -> over

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "nav/behaviours/moment.h"
#include "nav/motion/path_follower.h"
#include "nav/motion/stuck_detector.h"

namespace segsim::nav {

struct RecoveryOptions {
  StuckOptions stuck = {};
  /// So many decisions in a row in which the follower found no safe way forward begin a
  /// recovery, too; 0: never.
  int blocked_decisions = 0;
  int most = 12;  ///< Recoveries in an episode.
  double back_m = 0.15, back_mps = 0.2;
  /// Backs up only where the map shows room behind the robot.
  bool back_where_safe = true;
  double turn_min_rad = 0.52, turn_max_rad = 1.57;  ///< 30 .. 90 degrees, to either side.
  double turn_tolerance_rad = 0.15;
  double phase_s = 3.0;  ///< Longest time for backing and for turning, each.
  /// What was felt: a disc whose centre lies this far beyond the robot's edge; its radius
  /// grows each time around the same place.
  double felt_beyond_m = 0.05;
  double felt_m = 0.05, felt_more_m = 0.05, felt_most_m = 0.20;
  double same_place_m = 0.5;  ///< Recoveries this near to one another count together.
  std::string random_stream = "recovery";  ///< Of the episode's seed.
};

/// Something that was touched and not seen, frame Odom.
struct FeltDisc {
  glm::dvec2 center_m{0.0};
  double radius_m = 0.0;
};

class Recovery {
 public:
  /// @param robot_radius_m  Where the robot's edge is, ahead.
  Recovery(const RecoveryOptions& options, double robot_radius_m);
  /// Starts an episode.
  void reset(std::uint64_t seed);

  /// To be told every decision outside of a recovery: where it was made, the command, and
  /// whether the follower found no safe way forward.
  void watch(const core::Pose2& T_odom_robot, const core::VelocityCommand& command,
             bool blocked);
  /// What was watched no longer matters: the robot stands on purpose.
  void forget_motion();
  /// Whether the robot is stuck; never during a recovery.
  [[nodiscard]] bool due() const;
  /// All recoveries of the episode were used.
  [[nodiscard]] bool exhausted() const { return count_ >= options_.most; }

  /// Begins one. @return  What to mark as an obstacle; nullopt if the robot did not try in
  /// vain but saw no way forward.
  std::optional<FeltDisc> begin(const Moment& now);
  [[nodiscard]] bool active() const { return active_; }
  /// The command of this decision; nullopt when the recovery is over.
  [[nodiscard]] std::optional<core::VelocityCommand> command(const Moment& now,
                                                             const PathFollower& follower,
                                                             const CostMap& map);
  /// Forgets where the robot was stuck before.
  void forget_places() { places_m_.clear(); }

 private:
  [[nodiscard]] std::optional<FeltDisc> felt(const Moment& now) const;

  RecoveryOptions options_;
  double robot_radius_m_;
  std::uint64_t seed_ = 0;
  StuckDetector stuck_;
  int blocked_ = 0;  ///< Decisions in a row.
  int count_ = 0;
  std::vector<glm::dvec2> places_m_;

  bool active_ = false, turning_ = false;
  core::Pose2 start_;
  core::TimeNs since_ns_ = 0;  ///< Of the present phase.
  double yaw_rad_ = 0.0;       ///< To turn to.
};

}  // namespace segsim::nav
