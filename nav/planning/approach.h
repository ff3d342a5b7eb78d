#pragma once

/// @file
/// From where to look at an object: near it, reachable, with a free line of sight, and far
/// enough that a camera on a mast still has it in the image.

#include <optional>

#include "core/stages.h"
#include "nav/objects/object_map.h"
#include "nav/planning/cost_map.h"
#include "nav/planning/grid_planner.h"

namespace segsim::nav {

struct ApproachPlace {
  glm::dvec2 position_m{0.0};  ///< Centre of a reachable cell, Odom.
  double to_object_m = 0.0;    ///< Planar distance to the object's nearest cell.
  bool line_of_sight = false;
  bool open_floor = false;  ///< Nothing that the body would hit lies in between.
  double cost_m = 0.0;      ///< Weighted way from the field's start.
};

/// How far from an object's surface the robot stops to look at it.
struct ApproachDistances {
  double min_m = 0.6, max_m = 0.9;  ///< Preferred, or a little beyond view distance.
  double limit_m = 1.5;     ///< Allowed where nothing nearer is reachable, or where the object
                            ///< would drop below the image if nearer.
  double far_look_m = 1.1;  ///< Of a look from farther away: very near it may fill the image.
  double arrival_m = 0.10;  ///< Places keep this inside the limit: cell size, goal tolerance.
  double width_m = 0.25;    ///< Of the preferred range at least.
  double sight_limit_m = 0.3;  ///< View distance counts up to this much inside the limit.
};

/// Distances from one object for places to drive to.
struct ApproachRange {
  double min_m = 0.0, max_m = 0.0, limit_m = 0.0;
};

/// @param view_m  From where on the object is in the image, view_distance_m().
[[nodiscard]] ApproachRange approach_range(const ApproachDistances& distances, double view_m,
                                           bool from_afar);

/// Planar distance from the object's nearest point at which half of its cloud lies above the
/// camera's lowest ray, coming from where the robot is; 0 if that is not below the camera.
/// Nearer, a low object leaves the image of a level camera.
[[nodiscard]] double view_distance_m(const core::Observation& observation,
                                     const MappedObject& object);

/// Whether nothing as high as the camera stands between the two points; the last `skip_m`
/// before `to_m` are not looked at (the object itself).
[[nodiscard]] bool line_of_sight(const CostMap& map, const glm::dvec2& from_m,
                                 const glm::dvec2& to_m, double skip_m = 0.25);

/// Whether no obstacle for the body is known between the two points; the last `skip_m` before
/// `to_m` are not looked at. Across a kitchen counter the object is in sight, yet not at hand.
[[nodiscard]] bool open_floor(const CostMap& map, const glm::dvec2& from_m,
                              const glm::dvec2& to_m, double skip_m = 0.45);

/// The cheapest reachable cell at `min_m` .. `max_m` from the object with line of sight, if
/// possible across open floor; else one up to `limit_m`; else the reachable cell nearest to
/// the object, however far it is.
/// @return  nullopt if no cell is reachable at all.
[[nodiscard]] std::optional<ApproachPlace> choose_approach(const CostMap& map,
                                                           const GeodesicField& field,
                                                           const MappedObject& object,
                                                           double min_m, double max_m,
                                                           double limit_m);

/// Up to `count` reachable places far from one another and from the start of the field, for a
/// second look around the explored area; in the order of visit (nearest first).
[[nodiscard]] std::vector<glm::dvec2> spread_places(const CostMap& map,
                                                    const GeodesicField& field, int count);

}  // namespace segsim::nav
