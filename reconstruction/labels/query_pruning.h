#pragma once

/// @file
/// Which queries to keep (PanopticRecon++; shares and the frame rule are this project's).

#include <cstdint>
#include <span>
#include <vector>

#include "reconstruction/labels/panoptic_config.h"

namespace segsim::reconstruction {

struct QueryUse {
  std::int64_t matches = 0;         ///< Since training began.
  std::int64_t recent_matches = 0;  ///< Since the last pruning.
  std::int64_t frames = 0;          ///< Distinct frames among the matches.
  /// Surfels that the query claims (A > overlap_score), ascending ids.
  std::vector<std::int64_t> surfels;
};

/// Removes queries that were not matched recently or in fewer than min_frames frames; then,
/// from the most matched to the least, those whose surfels overlap those of a kept query by
/// more than max_overlap of the smaller of the two.
/// @return  Kept queries, ascending; all of them if none would be left.
[[nodiscard]] std::vector<std::int64_t> queries_to_keep(std::span<const QueryUse> queries,
                                                        const QueryConfig& config);

}  // namespace segsim::reconstruction
