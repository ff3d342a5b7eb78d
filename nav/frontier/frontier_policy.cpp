#include "nav/frontier/frontier_policy.h"

#include "core/check.h"
#include "nav/frontier/internal/search_policy.h"

namespace segsim::nav {

std::unique_ptr<core::Policy> make_frontier_policy(const FrontierPolicyOptions& options) {
  SEGSIM_CHECK(options.spin_rate_radps > 0.0, "spin_rate_radps");
  SEGSIM_CHECK(options.replan_period_s >= 0.0, "replan_period_s");
  SEGSIM_CHECK(options.stop_distance_limit_m >= options.stop_distance_m,
               "stop_distance_limit_m");
  SEGSIM_CHECK(options.approach_max_m > options.approach_min_m, "approach_max_m");
  return std::make_unique<internal::SearchPolicy>(options);
}

}  // namespace segsim::nav
