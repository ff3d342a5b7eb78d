#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/stages.h"

namespace segsim::perception {

inline constexpr double kCiouEps = 1e-7;

/// Complete IoU (Zheng et al. 2020, "Distance-IoU loss"): IoU - rho^2 / c^2 - alpha v, with
/// rho the distance of the centres, c the diagonal of the enclosing box, v the difference of
/// the aspects and alpha = v / (v - IoU + 1).
[[nodiscard]] inline double ciou(const core::BoxPx& a, const core::BoxPx& b) {
  const double wa = double{a.x1} - a.x0, ha = double{a.y1} - a.y0 + kCiouEps;
  const double wb = double{b.x1} - b.x0, hb = double{b.y1} - b.y0 + kCiouEps;
  const double wi = std::max(0.0, double{std::min(a.x1, b.x1)} - std::max(a.x0, b.x0));
  const double hi = std::max(0.0, double{std::min(a.y1, b.y1)} - std::max(a.y0, b.y0));
  const double overlap = wi * hi / (wa * ha + wb * hb - wi * hi + kCiouEps);
  const double wc = double{std::max(a.x1, b.x1)} - std::min(a.x0, b.x0);
  const double hc = double{std::max(a.y1, b.y1)} - std::min(a.y0, b.y0);
  const double dx = (double{b.x0} + b.x1 - a.x0 - a.x1) / 2.0;
  const double dy = (double{b.y0} + b.y1 - a.y0 - a.y1) / 2.0;
  const double distance = (dx * dx + dy * dy) / (wc * wc + hc * hc + kCiouEps);
  const double angle = std::atan(wb / hb) - std::atan(wa / ha);
  const double v = 4.0 / (std::numbers::pi * std::numbers::pi) * angle * angle;
  const double alpha = v / (v - overlap + 1.0 + kCiouEps);
  return overlap - distance - alpha * v;
}

}  // namespace segsim::perception
