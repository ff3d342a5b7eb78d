#include "reconstruction/datasets/world_placement.h"

#include <cstdio>
#include <numbers>

#include <glm/geometric.hpp>

namespace segsim::reconstruction {
namespace {

template <class... Values>
std::string formatted(const char* format, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

/// "+Z" for an axis, else the direction.
std::string direction_text(const glm::dvec3& up) {
  if (up == glm::dvec3(0.0, 1.0, 0.0)) return "source +Y";
  if (up == glm::dvec3(0.0, 0.0, 1.0)) return "source +Z";
  return formatted("source (%.4f, %.4f, %.4f)", up.x, up.y, up.z);
}

std::string gravity_text(const GravityEvidence& gravity) {
  return formatted(
      "%.0f %% of %zu surface patches are level and %.0f %% upright, %.0f %% of the cameras "
      "are not rolled, +-%.2f deg",
      100.0 * gravity.level_share, gravity.elements, 100.0 * gravity.wall_share,
      100.0 * gravity.upright_share, gravity.spread_rad * 180.0 / std::numbers::pi);
}

std::string up_text(const WorldPlacement& placement) {
  const std::string up = direction_text(placement.up) + " is up";
  if (placement.up_source == UpSource::kGiven) return up + " (given)";
  if (placement.up_source == UpSource::kEvidence) {
    return up + " (by evidence: " + gravity_text(*placement.gravity) + ")";
  }
  const bool agrees = placement.gravity && placement.gravity->sure() &&
                      glm::dot(placement.gravity->up, placement.up) > 0.99;
  return up + (agrees ? " (the layout's; " + gravity_text(*placement.gravity) + ")"
                      : " (the layout's)");
}

std::string floor_text(const WorldPlacement& placement) {
  const std::string floor =
      formatted("floor at source height %.4g m", placement.floor_height_m);
  switch (placement.floor_source) {
    case FloorSource::kGiven:
      return floor + " (given)";
    case FloorSource::kFitted:
      return floor + (placement.floor ? formatted(" (fitted: %.1f m2 seen, %.0f %% of the "
                                                  "cameras stand above it)",
                                                  placement.floor->area_m2,
                                                  100.0 * placement.floor->camera_share)
                                      : " (fitted)");
    case FloorSource::kGuessed:
      return floor + formatted(" (guessed: %.0f %% of the walls end there)",
                               100.0 * placement.floor->wall_share);
    case FloorSource::kUnknown:
      break;
  }
  return "floor unknown, source heights kept";
}

}  // namespace

std::string describe(const WorldPlacement& placement) {
  return "world: " + up_text(placement) + ", " + floor_text(placement);
}

}  // namespace segsim::reconstruction
