#pragma once

/// @file
/// The state machine behind make_frontier_policy().

#include <optional>
#include <span>
#include <vector>

#include "core/stages.h"
#include "nav/behaviours/moment.h"
#include "nav/behaviours/replan_timer.h"
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
  using Now = Moment;
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
  core::VelocityCommand perform(const Now& now);
  [[nodiscard]] core::PolicyMode mode() const;
  core::VelocityCommand spin(const Now& now);
  core::VelocityCommand explore(const Now& now);
  core::VelocityCommand look(const Now& now);
  core::VelocityCommand sweep(const Now& now);
  core::VelocityCommand recover(const Now& now);
  void begin_spin();
  void begin_recovery(const Now& now);
  /// Back to exploring, or to the sweep if one is under way.
  void resume_search();
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
  void begin_navigate(int id);
  core::VelocityCommand navigate(const Now& now);
  core::VelocityCommand verify(const Now& now);
  bool replan_navigate(const Now& now, const MappedObject& object);
  ApproachRange range_of(const Now& now, const MappedObject& object) const;
  std::optional<Path> way_to_old_place(const Now& now, const MappedObject& object,
                                       const ApproachRange& range, const ApproachPlace& better,
                                       ApproachRank rank);
  /// Whether the stop rule holds.
  bool at_goal(const Now& now, const MappedObject& object) const;
  double stop_distance_m(const Now& now, const MappedObject& object) const;
  double facing_error_rad(const Now& now, const MappedObject& object) const;
  bool recently_seen(const Now& now, const MappedObject& object) const;
  void give_up_object();

  FrontierPolicyOptions options_;
  core::ObjectGoal goal_;

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

  // The behaviours that explore() and navigate() hand over to.
  Spin spin_;
  Recovery recovery_;
  Sweep sweep_;
  ObjectVerification verification_;

  State state_ = State::kSpin;
  std::optional<core::StopReason> stop_reason_;
  bool begun_ = false;
  ReplanTimer replan_;
  std::vector<Frontier> frontiers_;
  std::optional<Target> target_;
  std::optional<glm::dvec2>
      looked_at_m_;  ///< Frontier whose surroundings were just looked at.
  Effort effort_ = Effort::kNormal;
  State before_recovery_ = State::kExplore;

  int object_id_ = -1;
  ApproachRank approach_rank_ = ApproachRank::kNone;  ///< Of the present target.
  int replaced_verifications_ = 0;                    ///< In a row, of the present object.
  std::vector<core::TimeNs> postponed_until_ns_;      ///< Per object id.
};

}  // namespace segsim::nav::internal
