#pragma once

/// @file
/// The state machine behind make_frontier_policy().

#include <optional>
#include <set>
#include <span>
#include <vector>

#include "core/random.h"
#include "core/stages.h"
#include "nav/frontier/frontier_policy.h"
#include "nav/planning/approach.h"

namespace segsim::nav::internal {

class SearchPolicy final : public core::Policy {
 public:
  explicit SearchPolicy(const FrontierPolicyOptions& options);

  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override;
  [[nodiscard]] core::Decision decide(const core::Observation& observation,
                                      std::span<const core::Detection> detections) override;
  [[nodiscard]] core::PolicyView view() const override;

 private:
  enum class State : std::uint8_t {
    kSpin,      ///< Look around on the spot; afterwards explore.
    kExplore,   ///< Drive to a frontier.
    kLook,      ///< At a frontier: turn towards the unknown.
    kSweep,     ///< Drive to a place of the second look around.
    kNavigate,  ///< Drive to a place near the object.
    kVerify,    ///< At the place: face the object, wait for a detection.
    kRecover,   ///< Back up and turn after being stuck.
    kStopped
  };
  /// What decide() knows about now.
  struct Now {
    const core::Observation* observation;
    core::Pose2 pose;
    glm::dvec2 position_m;
    core::TimeNs time_ns;
  };
  /// Progress towards the present target.
  struct Target {
    glm::dvec2 position_m{0.0};
    glm::dvec2 outward{0.0};
    core::TimeNs since_ns = 0, progress_ns = 0;
    double best_to_go_m = 1e18;
    bool bold = false;  ///< In the unknown.
  };
  /// How good the place near the object is; lower is better.
  enum class ApproachRank : std::uint8_t { kOpen, kOpenBeyondUnknown, kInSight, kFar, kNone };
  /// What is tried, in this order, when no frontier is left.
  enum class Effort : std::uint8_t { kNormal, kTight, kBold, kSweep, kBoldAgain };

  // search_policy.cpp: the frame of every decision, maps and targets, recovering;
  // search_policy_explore.cpp: looking around and exploring.
  core::VelocityCommand act(const Now& now);
  core::VelocityCommand spin(const Now& now);
  core::VelocityCommand explore(const Now& now);
  core::VelocityCommand look(const Now& now);
  core::VelocityCommand sweep(const Now& now);
  core::VelocityCommand recover(const Now& now);
  void begin_spin(const Now& now);
  void begin_recovery(const Now& now);
  bool replan_explore(const Now& now);
  /// Drives to the nearest place inside the unknown that may be passable.
  bool replan_bold(const Now& now);
  /// No frontier is left: tentative objects, then the next effort, at last stop.
  void escalate(const Now& now);
  void stop(core::StopReason reason);
  bool replan_due(const Now& now) const;
  void refresh_cost_map();
  /// Remembers for either cost map what the map changed since it was computed.
  void note_map_changes();
  [[nodiscard]] CellBox on_map(const CellBox& on_lattice) const;
  /// The map in which everything unknown counts as free, narrow inflation.
  void build_bold_map();
  void track_target(const Now& now, const glm::dvec2& target_m, const glm::dvec2& outward);
  bool hopeless(const Now& now);
  /// Plans to the place and hands the path to the follower; false if there is no way.
  bool drive_to(const Now& now, const glm::dvec2& place_m) {
    return drive_to(now, place_m, cost_);
  }
  bool drive_to(const Now& now, const glm::dvec2& place_m, const CostMap& map);

  // search_policy_object.cpp: going to the object.
  const MappedObject* best_object(const Now& now) const;
  const MappedObject* best_tentative(const Now& now) const;
  void begin_navigate(const Now& now, int id);
  core::VelocityCommand navigate(const Now& now);
  core::VelocityCommand verify(const Now& now);
  bool replan_navigate(const Now& now, const MappedObject& object);
  /// Range of distances from the object for places to drive to.
  struct ApproachRange {
    double min_m, max_m, limit_m;
  };
  ApproachRange approach_range(const Now& now, const MappedObject& object) const;
  bool still_good(const Now& now, const MappedObject& object, const ApproachRange& range,
                  const ApproachPlace& better, ApproachRank rank);
  void resume_search();
  /// Whether the stop rule holds.
  bool at_goal(const Now& now, const MappedObject& object) const;
  double stop_distance_m(const Now& now, const MappedObject& object) const;
  double facing_error_rad(const Now& now, const MappedObject& object) const;
  bool recently_seen(const Now& now, const MappedObject& object) const;
  void give_up_object(const Now& now);

  FrontierPolicyOptions options_;
  core::ObjectGoal goal_;
  std::uint64_t seed_ = 0;

  OccupancyMap map_;
  CostMap cost_;
  CostMap bold_;
  bool cost_fresh_ = false;
  CellBox cost_changed_, bold_changed_;  ///< On the lattice of GridFrame.
  GeodesicField field_;                  ///< Of the last decision that needed one.
  PlannerMemory planner_;
  ObjectMap objects_;
  FrontierSelector selector_;
  PathFollower follower_;
  StuckDetector stuck_;

  State state_ = State::kSpin;
  std::optional<core::StopReason> stop_reason_;
  core::TimeNs replanned_ns_ = -1;
  std::vector<Frontier> frontiers_;
  std::optional<Target> target_;
  std::optional<glm::dvec2>
      looked_at_m_;  ///< Frontier whose surroundings were just looked at.
  int blocked_decisions_ = 0;

  double spun_rad_ = 0.0;
  double last_yaw_rad_ = 0.0;

  Effort effort_ = Effort::kNormal;
  std::vector<glm::dvec2> sweep_places_m_;  ///< Still to visit, last first.

  int object_id_ = -1;
  ApproachRank approach_rank_ = ApproachRank::kNone;  ///< Of the present target.
  core::TimeNs verify_since_ns_ = 0, facing_since_ns_ = -1;
  int replaced_verifications_ = 0;  ///< In a row, of the present object.
  std::set<int> second_look_;       ///< Objects that are or were looked at from farther.
  std::vector<core::TimeNs> postponed_until_ns_;  ///< Per object id.

  State before_recovery_ = State::kExplore;
  core::Pose2 recovery_start_;
  core::TimeNs recovery_since_ns_ = 0;
  bool recovery_turning_ = false;
  double recovery_yaw_rad_ = 0.0;
  std::uint64_t recoveries_ = 0;
  std::vector<glm::dvec2> stuck_places_m_;
};

}  // namespace segsim::nav::internal
