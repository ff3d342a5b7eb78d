#include "nav/motion/local_policy.h"

#include <glm/geometric.hpp>

#include "nav/planning/fast_marching.h"
#include "nav/planning/grid_planner.h"

namespace segsim::nav {
namespace {

class GridLocalPolicy final : public LocalPolicy {
 public:
  explicit GridLocalPolicy(const GridLocalOptions& options) : options_(options) {}
  void reset() override {}
  DiscreteAction act(const core::Observation&, const core::Pose2& pose,
                     const glm::dvec2& goal_m, const CostMap& map) override {
    const glm::dvec2 position_m(pose.x_m, pose.y_m);
    if (glm::distance(position_m, goal_m) <= options_.arrive_m) return DiscreteAction::kStop;
    const auto place_m = options_.planner == GridPlanner::kAstar
                             ? along_path(map, position_m, goal_m)
                             : along_slope(map, position_m, goal_m);
    return place_m ? action_towards(pose, *place_m, options_.actions) : DiscreteAction::kStop;
  }

 private:
  [[nodiscard]] std::optional<glm::dvec2> along_path(const CostMap& map,
                                                     const glm::dvec2& position_m,
                                                     const glm::dvec2& goal_m) const {
    const std::optional<Path> path = plan_path(map, position_m, goal_m);
    if (!path || path->points_m.empty()) return std::nullopt;
    double left_m = options_.lookahead_m;
    glm::dvec2 from_m = position_m;
    for (const glm::dvec2& point_m : path->points_m) {
      const double step_m = glm::distance(from_m, point_m);
      if (step_m >= left_m && step_m > 0.0) {
        return from_m + (point_m - from_m) * (left_m / step_m);
      }
      left_m -= step_m;
      from_m = point_m;
    }
    return path->points_m.back();
  }

  [[nodiscard]] static std::optional<glm::dvec2> along_slope(const CostMap& map,
                                                             const glm::dvec2& position_m,
                                                             const glm::dvec2& goal_m) {
    const GridFrame& frame = map.frame();
    const auto goal = nearest_traversable(map, frame.cell_at(goal_m));
    const auto from = nearest_traversable(map, frame.cell_at(position_m));
    if (!goal || !from) return std::nullopt;
    const auto next = short_term_goal(map, fast_marching_m(map, {*goal}), *from);
    if (!next) return std::nullopt;
    return frame.center_m(*next);
  }

  GridLocalOptions options_;
};

}  // namespace

std::unique_ptr<LocalPolicy> make_grid_local_policy(const GridLocalOptions& options) {
  return std::make_unique<GridLocalPolicy>(options);
}

}  // namespace segsim::nav
