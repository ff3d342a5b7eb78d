#pragma once

/// @file
/// The state machine behind make_vlfm_policy().

#include <optional>
#include <span>
#include <unordered_set>
#include <vector>

#include "nav/objects/object_map.h"
#include "nav/planning/grid_planner.h"
#include "nav/vlfm/vlfm_policy.h"

namespace segsim::nav::internal {

class VlfmSearch final : public core::Policy {
 public:
  explicit VlfmSearch(const VlfmOptions& options);

  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override;
  [[nodiscard]] core::Decision decide(const core::Observation& observation,
                                      std::span<const core::Detection> detections) override;
  [[nodiscard]] core::PolicyView view() const override;

 private:
  struct Now {
    const core::Observation* observation;
    std::span<const core::Detection> detections;
    core::Pose2 pose;
    glm::dvec2 position_m;
    core::TimeNs time_ns;
    double period_s;  ///< Since the last decision.
  };

  // vlfm_search.cpp: maps and modes; vlfm_search_object.cpp: going to the object.
  void update_maps(const Now& now);
  core::VelocityCommand act(const Now& now);
  core::VelocityCommand explore(const Now& now);
  core::VelocityCommand navigate(const Now& now, const glm::dvec3& object_m);
  core::VelocityCommand look_again(const Now& now, const glm::dvec3& object_m);
  std::optional<glm::dvec2> choose_frontier(const Now& now);
  std::optional<glm::dvec2> place_beside(const Now& now, const glm::dvec2& object_m);
  [[nodiscard]] MappedObject object_at(const glm::dvec2& object_m) const;
  std::optional<glm::dvec2> approach_place(const Now& now, const glm::dvec2& object_m);
  core::VelocityCommand approach(const Now& now, const glm::dvec3& object_m);
  [[nodiscard]] bool seen_now(const Now& now, const glm::dvec3& object_m) const;
  [[nodiscard]] bool at_its_place(const Now& now, const core::BoxPx& box,
                                  const glm::dvec3& object_m) const;
  [[nodiscard]] bool vetoed(const glm::dvec2& place_m) const;
  void stop(core::StopReason reason);

  // vlfm_sweep.cpp: what is left when no frontier is.
  void note_near_cells(const Now& now);
  [[nodiscard]] bool nothing_new(const Now& now);
  [[nodiscard]] bool squeeze_through();
  std::optional<glm::dvec2> next_sweep_place(const Now& now);
  [[nodiscard]] bool swept(const glm::dvec2& place_m) const;
  core::VelocityCommand sweep_to(const Now& now, const glm::dvec2& place_m);
  core::VelocityCommand spin_for_sweep(const Now& now);

  // vlfm_search_motion.cpp: carrying it out.
  core::VelocityCommand spin(const Now& now);
  core::VelocityCommand drive(const Now& now, const glm::dvec2& place_m, bool exploring);
  core::VelocityCommand start(DiscreteAction action, const Now& now);
  core::VelocityCommand face(const Now& now, double bearing_rad);
  void refresh_cost_map();
  void begin_recovery(const Now& now);
  core::VelocityCommand recover(const Now& now);
  [[nodiscard]] bool replan_due(const Now& now) const;

  VlfmOptions options_;
  core::ObjectGoal goal_;
  std::uint64_t seed_ = 0;

  ObstacleMap obstacles_;
  ValueMap values_;
  ClassCloud cloud_;
  FrontierChooser chooser_;
  CostMap cost_;
  GeodesicField field_;  ///< Of the last decision that needed one.
  PlannerMemory planner_;
  PathFollower follower_;
  DiscreteExecutor executor_;
  StuckDetector stuck_;

  core::PolicyMode mode_ = core::PolicyMode::kInitialize;
  std::optional<core::StopReason> stop_reason_;
  std::optional<core::TimeNs> last_time_ns_;
  int turns_ = 0;
  double spun_rad_ = 0.0, last_yaw_rad_ = 0.0;
  std::vector<ContourFrontier> frontiers_;
  std::optional<glm::dvec2> target_m_;
  core::TimeNs planned_ns_ = -1;
  glm::dvec2 planned_for_m_{0.0};
  std::vector<glm::dvec2> vetoed_m_;
  std::optional<core::TimeNs> looking_since_ns_;
  core::TimeNs postponed_until_ns_ = 0;  ///< Objects are left alone: one was out of reach.
  bool looked_from_afar_ = false;  ///< The present object gets its look from farther away.

  std::unordered_set<std::uint64_t> seen_near_;  ///< Coarse cells that a near view showed.
  std::optional<glm::dvec2> sweep_m_;
  std::vector<glm::dvec2> swept_m_;
  core::TimeNs sweep_since_ns_ = 0;
  int sweeps_ = 0;
  std::size_t news_ = 0;  ///< Of seen_near_, when it grew last.
  std::optional<core::TimeNs> news_ns_;
  bool sweep_spinning_ = false;
  std::size_t squeezes_ = 0;  ///< So many of the narrow inflations were needed.

  bool recovering_ = false, recovery_turning_ = false;
  core::Pose2 recovery_start_;
  core::TimeNs recovery_since_ns_ = 0;
  double recovery_yaw_rad_ = 0.0;
  int recoveries_ = 0;
  std::vector<glm::dvec2> stuck_places_m_;
};

}  // namespace segsim::nav::internal
