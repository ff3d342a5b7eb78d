#include "nav/vlfm/vlfm_policy.h"

#include <algorithm>

#include "nav/behaviours/fitted_options.h"
#include "nav/vlfm/internal/vlfm_search.h"

namespace segsim::nav {

VlfmOptions vlfm_for(const core::RobotBase& robot, const VlfmRules& rules,
                     double camera_height_m) {
  const RobotFit fit = fit_of(robot);
  VlfmOptions options;
  options.rules = rules;
  options.cost = fitted(options.cost, robot);
  options.actions = fitted(options.actions, robot);
  options.follower = fitted(options.follower, robot);
  options.recovery = fitted(options.recovery, robot);
  options.distances = fitted(options.distances, robot);
  options.stop_radius_m = std::max(options.stop_radius_m, options.distances.min_m);
  options.tight_radii_m = {fit.tight_radius_m, fit.narrow_radius_m};
  options.obstacles.robot_radius_m = fit.radius_m;
  options.obstacles.mast_radius_m = fit.mast_radius_m;
  options.obstacles.band_min_m = fit.obstacle_min_m;
  options.obstacles.band_max_m =
      rules.published(Quirk::kObstaclesStay) ? camera_height_m + 0.05 : fit.obstacle_max_m;
  options.obstacles.occupancy = fitted(options.obstacles.occupancy, robot);
  options.obstacles.occupancy.ray_step_x_px = 2;
  options.obstacles.occupancy.ray_step_y_px = 3;
  options.obstacles.occupancy.wall_part_m = 0.2;
  options.obstacles.depth.min_depth_m = 0.1;  // The renderer's camera measures from there on.
  options.values.min_depth_m = 0.1;
  options.values.band_max_m = camera_height_m + 0.1;
  // Equal values are the rule as long as the prior has nothing to go by.
  if (!rules.published(Quirk::kVetoFallback)) options.choice.tie_margin = 0.02;
  options.obstacles.measured_where_enclosed = !rules.published(Quirk::kEmptyCone);
  // Both belong to the repaired handling of places that cannot be reached.
  if (rules.published(Quirk::kNoRecovery)) {
    options.approach = false;
    options.sweep.most_places = 0;
  }
  return options;
}

std::unique_ptr<core::Policy> make_vlfm_policy(const VlfmOptions& options) {
  return std::make_unique<internal::VlfmSearch>(options);
}

}  // namespace segsim::nav
