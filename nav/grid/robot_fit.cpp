#include "nav/grid/robot_fit.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"

namespace segsim::nav {
namespace {

double to_centimetres(double length_m) { return std::round(100.0 * length_m) / 100.0; }

}  // namespace

RobotFit fit_of(const core::RobotShape& shape) {
  constexpr double kTightShare = 0.55, kInsideShare = 0.65;
  constexpr double kNarrow_m = 0.02, kFollower_m = 0.01, kMast_m = 0.05, kFloorNoise_m = 0.04;
  const double inner_m = shape.inscribed_radius_m();
  const double outer_m = shape.circumscribed_radius_m();
  SEGSIM_CHECK(inner_m > 0.0, "a robot without size");
  RobotFit fit;
  fit.radius_m = to_centimetres(outer_m);
  fit.tight_radius_m = to_centimetres(inner_m + kTightShare * (outer_m - inner_m));
  fit.narrow_radius_m = std::min(inner_m + kNarrow_m, fit.tight_radius_m);
  fit.footprint_radius_m = to_centimetres(fit.tight_radius_m - kFollower_m);
  fit.inside_radius_m = std::min(kInsideShare * fit.radius_m, inner_m);
  fit.mast_radius_m = shape.mast_radius_m + kMast_m;
  fit.obstacle_min_m = shape.clearance_m + kFloorNoise_m;
  fit.obstacle_max_m = shape.body_top_m;
  return fit;
}

}  // namespace segsim::nav
