#pragma once

/// @file
/// Grids of a table of many scenes: does what a detector has learnt carry over?

#include "experiments/results/table.h"
#include "experiments/support/grid_document.h"

namespace segsim::experiments::results::internal {

/// One row for each arm, over all scenes: how it did, by our rule and the strictest named one,
/// and whether it had seen the scenes.
[[nodiscard]] support::internal::Grid leaderboard_grid(const ResultTable& table);

/// Every arm against "before", over each pool of scenes and all; no rows without such arms.
[[nodiscard]] support::internal::Grid generalisation_grid(const ResultTable& table);

/// Every scene and every arm side by side. Rates of arms that were trained on views of the
/// scene have a star.
[[nodiscard]] support::internal::Grid mixed_grid(const ResultTable& table);

}  // namespace segsim::experiments::results::internal
