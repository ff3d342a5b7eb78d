#include "sim/trial/metrics.h"

#include <algorithm>
#include <cmath>

namespace segsim::sim {

double spl(bool success, double shortest_path_m, double path_m) {
  if (!success || !std::isfinite(shortest_path_m)) return 0.0;
  const double longer_m = std::max(shortest_path_m, path_m);
  return longer_m > 0.0 ? shortest_path_m / longer_m : 1.0;
}

double soft_spl(double distance_to_goal_m, double shortest_path_m, double path_m) {
  if (!std::isfinite(shortest_path_m) || !std::isfinite(distance_to_goal_m)) return 0.0;
  if (shortest_path_m <= 0.0) return path_m <= 0.0 && distance_to_goal_m <= 0.0 ? 1.0 : 0.0;
  const double progress = std::max(0.0, 1.0 - distance_to_goal_m / shortest_path_m);
  return progress * shortest_path_m / std::max(shortest_path_m, path_m);
}

}  // namespace segsim::sim
