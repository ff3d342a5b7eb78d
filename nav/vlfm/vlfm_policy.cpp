#include "nav/vlfm/vlfm_policy.h"

#include <algorithm>
#include <sstream>

#include "nav/behaviours/fitted_options.h"
#include "nav/vlfm/internal/vlfm_search.h"

namespace segsim::nav {

VlfmOptions published_vlfm() {
  VlfmOptions options;
  options.rules = VlfmRules(Rule::kVlfm);
  options.motion = Motion::kDiscrete;
  options.second_look = false;
  options.approach = false;
  options.sweep.most_places = 0;
  options.min_score = 0.8;
  return options;  // The defaults of the maps are the published ones.
}

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

DetectorRoute route_target(const std::string& target,
                           const std::vector<std::string>& closed_set_names,
                           const std::vector<std::string>& open_set_targets,
                           const VlfmRules& rules) {
  const auto contains = [](const std::vector<std::string>& names, const std::string& name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  std::istringstream text(target);
  bool any_known = false, any_unknown = false, any_routed = false;
  for (std::string alias; std::getline(text, alias, '|');) {
    (contains(closed_set_names, alias) ? any_known : any_unknown) = true;
    any_routed |= contains(open_set_targets, alias);
  }
  if (rules.published(Quirk::kClosedSetRoute)) return {any_known, any_unknown};
  if (any_routed) return {false, true};
  return {any_known, any_unknown && !any_known};
}

}  // namespace segsim::nav
