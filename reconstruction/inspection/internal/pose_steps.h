#pragma once

/// @file
/// How far two cameras are apart.

#include <cmath>
#include <numbers>

#include <glm/geometric.hpp>

#include "core/frames.h"

namespace segsim::reconstruction::internal {

[[nodiscard]] inline double way_m(const core::CameraPose& a, const core::CameraPose& b) {
  return glm::distance(a.translation_m(), b.translation_m());
}

[[nodiscard]] inline double turn_rad(const core::CameraPose& a, const core::CameraPose& b) {
  const glm::dquat q = glm::conjugate(a.rotation()) * b.rotation();
  return 2.0 * std::atan2(glm::length(glm::dvec3(q.x, q.y, q.z)), std::abs(q.w));
}

[[nodiscard]] inline double degrees(double angle_rad) {
  return angle_rad * 180.0 / std::numbers::pi;
}

}  // namespace segsim::reconstruction::internal
