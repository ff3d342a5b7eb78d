#pragma once

/// @file
/// The state machine behind make_vlfm_policy().

#include <optional>
#include <span>
#include <vector>

#include "nav/behaviours/moment.h"
#include "nav/behaviours/replan_timer.h"
#include "nav/behaviours/spin.h"
#include "nav/objects/object_map.h"
#include "nav/planning/grid_planner.h"
#include "nav/vlfm/internal/seen_near.h"
#include "nav/vlfm/vlfm_policy.h"

namespace segsim::nav::internal {

/// VLFM keeps one cloud for all objects of the class; to the behaviours it is one object.
inline constexpr int kTheObject = 0;

class VlfmSearch final : public core::Policy {
 public:
  explicit VlfmSearch(const VlfmOptions& options);

  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override;
  [[nodiscard]] core::Decision decide(const core::Observation& observation,
                                      std::span<const core::Detection> detections) override;
  [[nodiscard]] core::PolicyView view() const override;

 private:
  struct Now : Moment {
    std::span<const core::Detection> detections;
    double period_s = 0.0;  ///< Since the last decision.
  };

  /// The observation with inferred depth, if the options infer it.
  [[nodiscard]] core::Observation with_depth(const core::Observation& observation);
  // vlfm_search.cpp: maps and modes; vlfm_search_object.cpp: going to the object.
  void update_maps(const Now& now);
  core::VelocityCommand act(const Now& now);
  core::VelocityCommand perform(const Now& now);
  core::VelocityCommand look_around_first(const Now& now);
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
  [[nodiscard]] bool nothing_new(const Now& now);
  [[nodiscard]] bool squeeze_through();
  std::optional<glm::dvec2> next_sweep_place(const Now& now);
  core::VelocityCommand sweep_to(const Now& now, const glm::dvec2& place_m);

  // vlfm_search_motion.cpp: carrying it out.
  void begin_spin();
  /// A turn around; nullopt when it is over.
  std::optional<core::VelocityCommand> turn_around(const Now& now);
  core::VelocityCommand drive(const Now& now, const glm::dvec2& place_m, bool exploring);
  core::VelocityCommand start(DiscreteAction action, const Now& now);
  core::VelocityCommand face(const Now& now, double bearing_rad);
  void refresh_cost_map();
  void begin_recovery(const Now& now);
  core::VelocityCommand recover(const Now& now);
  [[nodiscard]] bool replan_due(const Now& now) const;

  VlfmOptions options_;
  core::ObjectGoal goal_;
  core::Image<float> inferred_m_;

  ObstacleMap obstacles_;
  ValueMap values_;
  ClassCloud cloud_;
  FrontierChooser chooser_;
  CostMap cost_;
  GeodesicField field_;  ///< Of the last decision that needed one.
  PlannerMemory planner_;
  PathFollower follower_;
  DiscreteExecutor executor_;

  // The behaviours that explore() and navigate() hand over to.
  Spin spin_;
  Recovery recovery_;
  Sweep sweep_;
  ObjectVerification verification_;

  core::PolicyMode mode_ = core::PolicyMode::kInitialize;
  std::optional<core::StopReason> stop_reason_;
  std::optional<core::TimeNs> last_time_ns_;
  int turns_ = 0;  ///< Of a turn around in discrete actions.
  std::vector<ContourFrontier> frontiers_;
  std::optional<glm::dvec2> target_m_;
  ReplanTimer replan_;
  glm::dvec2 planned_for_m_{0.0};
  std::vector<glm::dvec2> vetoed_m_;
  core::TimeNs postponed_until_ns_ = 0;  ///< Objects are left alone: one was out of reach.

  SeenNear seen_near_;
  bool sweep_spinning_ = false;
  std::size_t squeezes_ = 0;  ///< So many of the narrow inflations were needed.
};

}  // namespace segsim::nav::internal
