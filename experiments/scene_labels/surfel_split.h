#pragma once

/// @file
/// An object's surfels in parts: pieces that do not touch, or what lies nearer to one of
/// several places along the surface.

#include <span>
#include <vector>

#include <glm/vec3.hpp>

namespace segsim::experiments::scene_labels {

/// World frame. Two surfels touch if their centres are no farther apart than the gap and both
/// radii.
struct SurfelSet {
  std::vector<glm::vec3> position_m;
  std::vector<float> radius_m;  ///< Counted up to kLargestRadius_m.
};
inline constexpr float kLargestRadius_m = 0.05F;

/// Pieces that do not touch one another. Those with less than `least_share` of the surfels
/// are crumbs: they belong to the piece that is nearest.
/// @param gap_m  >= 0.
/// @return  Piece of every surfel; 0 is the largest, of equal ones that of the first surfel.
[[nodiscard]] std::vector<int> connected_pieces(const SurfelSet& surfels, double gap_m,
                                                double least_share);

struct Seed {
  glm::dvec3 p_m{0.0};  ///< World.
  int part = 0;
};

/// Regions that grow from the seeds over touching surfels, at equal speed; surfels that none
/// reaches go to the seed that is nearest in a straight line.
/// @param seeds  At least one.  @param gap_m  >= 0.
/// @return  Part of every surfel.
[[nodiscard]] std::vector<int> nearest_seeds(const SurfelSet& surfels, double gap_m,
                                             std::span<const Seed> seeds);

}  // namespace segsim::experiments::scene_labels
