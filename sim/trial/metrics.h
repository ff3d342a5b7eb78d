#pragma once

/// @file
/// Navigation metrics. l: shortest path, p: path driven, d: geodesic distance to the goal at
/// the end.
///
///     SPL     = S l / max(l, p)                      (Anderson et al. 2018)
///     SoftSPL = max(0, 1 - d / l) l / max(l, p)      (Datta et al. 2020)
///
/// Where Habitat divides by zero, these return a number: l = 0 gives 1 for a success without
/// motion and otherwise 0; an infinite l or d gives 0.

namespace segsim::sim {

[[nodiscard]] double spl(bool success, double shortest_path_m, double path_m);
[[nodiscard]] double soft_spl(double distance_to_goal_m, double shortest_path_m,
                              double path_m);

}  // namespace segsim::sim
