#pragma once

/// @file
/// Parts of table_grids.cpp and table_format.cpp: the grids of why trials went as they did,
/// and the JSON form.

#include <string>
#include <vector>

#include "experiments/results/table.h"
#include "experiments/support/grid_document.h"

namespace segsim::experiments::results::internal {

/// "0.85", or "-" of nothing.
[[nodiscard]] std::string share_text(int part, int whole);

/// One column per cause that occurred; no rows if no trial failed.
[[nodiscard]] support::internal::Grid causes_grid(const std::vector<GroupSummary>& groups);
[[nodiscard]] support::internal::Grid perception_grid(const std::vector<GroupSummary>& groups);
/// The same trials by the rules of others.
[[nodiscard]] support::internal::Grid profiles_grid(const std::vector<GroupSummary>& groups);

[[nodiscard]] std::string as_json(const ResultTable& table);

}  // namespace segsim::experiments::results::internal
