#include "nav/frontier/frontier_policy.h"

#include <algorithm>

#include "core/check.h"
#include "nav/behaviours/fitted_options.h"
#include "nav/frontier/internal/search_policy.h"

namespace segsim::nav {

FrontierPolicyOptions frontier_for(const core::RobotBase& robot,
                                   FrontierPolicyOptions wanted) {
  wanted.occupancy = fitted(wanted.occupancy, robot);
  wanted.cost = fitted(wanted.cost, robot);
  wanted.follower = fitted(wanted.follower, robot);
  wanted.recovery = fitted(wanted.recovery, robot);
  wanted.distances = fitted(wanted.distances, robot);
  wanted.tight_radius_m = fit_of(robot).tight_radius_m;
  wanted.stop_distance_m = std::max(wanted.stop_distance_m, wanted.distances.min_m);
  return wanted;
}

std::unique_ptr<core::Policy> make_frontier_policy(const FrontierPolicyOptions& options) {
  SEGSIM_CHECK(options.spin.rate_radps > 0.0, "spin.rate_radps");
  SEGSIM_CHECK(options.replan_period_s >= 0.0, "replan_period_s");
  SEGSIM_CHECK(options.distances.limit_m >= options.stop_distance_m, "distances.limit_m");
  SEGSIM_CHECK(options.distances.max_m > options.distances.min_m, "distances.max_m");
  return std::make_unique<internal::SearchPolicy>(options);
}

}  // namespace segsim::nav
