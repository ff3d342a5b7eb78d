#pragma once

/// @file
/// The frontier policy with VLFM's value map: `frontier-value`. Everything but the choice of
/// the frontier is nav/frontier/frontier_policy.h.

#include <memory>

#include "nav/frontier/frontier_policy.h"
#include "nav/value/image_text_scorer.h"
#include "nav/value/value_map.h"

namespace segsim::nav {

struct ValueSearchOptions {
  FrontierPolicyOptions frontier;  ///< Its scorer is replaced.
  ValueMapOptions values;
  double value_radius_m = 0.5;
  double value_weight_m = 8.0;  ///< Metres of way that a value of 1 instead of 0 is worth.
  double unseen_value = 0.3;    ///< Of frontiers without values around them.
  std::shared_ptr<ImageTextScorer> scorer;  ///< Null: constant.
};

[[nodiscard]] std::unique_ptr<core::Policy> make_value_search(
    const ValueSearchOptions& options);

}  // namespace segsim::nav
