#include "nav/motion/path_progress.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::nav {
namespace {

constexpr double kSearchAhead_m = 1.0;  // How far along the path the nearest point may jump.

}  // namespace

glm::dvec2 PathProgress::point_ahead(const std::vector<glm::dvec2>& points,
                                     const glm::dvec2& position_m, double ahead_m) {
  SEGSIM_CHECK(!points.empty(), "no path");
  // Nearest point from the last one on.
  double best_m = 1e18, searched_m = 0.0;
  std::size_t best_segment = segment_;
  double best_t = segment_t_;
  for (std::size_t k = segment_; k + 1 < points.size() && searched_m < kSearchAhead_m; ++k) {
    const glm::dvec2 along = points[k + 1] - points[k];
    const double length2 = glm::dot(along, along);
    const double from = k == segment_ ? segment_t_ : 0.0;
    const double t =
        length2 > 0.0
            ? std::clamp(glm::dot(position_m - points[k], along) / length2, from, 1.0)
            : 1.0;
    const double distance_m = glm::distance(position_m, points[k] + t * along);
    if (distance_m < best_m - 1e-9) {
      best_m = distance_m;
      best_segment = k;
      best_t = t;
    }
    searched_m += (1.0 - from) * std::sqrt(length2);
  }
  segment_ = best_segment;
  segment_t_ = best_t;
  // From there along the path.
  double left_m = ahead_m;
  for (std::size_t k = segment_; k + 1 < points.size(); ++k) {
    const glm::dvec2 from =
        k == segment_ ? points[k] + segment_t_ * (points[k + 1] - points[k]) : points[k];
    const double length_m = glm::distance(from, points[k + 1]);
    if (length_m >= left_m) return from + (points[k + 1] - from) * (left_m / length_m);
    left_m -= length_m;
  }
  return points.back();
}

}  // namespace segsim::nav
