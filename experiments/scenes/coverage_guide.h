#pragma once

/// @file
/// Which part of a place the reconstruction does not show to a robot, and from where a few
/// more frames would mend most of it.
///
/// The robot's camera looks around, level, from places all over its free space. A pixel of
/// alpha below 0.5 is a hole. How far away the missing surface is nobody knows: it is taken to
/// be as far as the farther of the two surfaces beside the hole in its row (what is missing is
/// mostly what something nearer hid), else at the wall of the scene's box. Holes are gathered
/// in voxels, and each voxel counts by the number of robot views that miss it. Views are then
/// wanted greedily: always the one whose voxels, without those of the views before, count most
/// (maximum coverage; Nemhauser, Wolsey & Fisher 1978 bound how far from the best that is).

#include <cstdint>
#include <vector>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "core/frames.h"
#include "core/image.h"
#include "core/render.h"
#include "experiments/drawing/floor_plan.h"
#include "sim/ground/world.h"

namespace segsim::experiments::scenes {

struct CoverageGuideOptions {
  double camera_height_m = 1.2;  ///< > 0.
  double spacing_m = 0.5;        ///< Between places. > 0.
  int directions = 8;            ///< From every place, evenly. > 0.
  int poses = 10;                ///< Wanted at most.
};

/// How badly the robot sees from one place.
struct CoveragePlace {
  glm::dvec2 p_m{0.0};
  double missing = 0.0;  ///< Share of the pixels of all its views that are holes.
};

/// A place and a direction from where one more frame helps.
struct WantedPose {
  core::Pose2 pose;    ///< World frame.
  double share = 0.0;  ///< Of all that the robot misses, this frame shows and none before.
};

struct CoverageGuide {
  double camera_height_m = 0.0;
  double missing = 0.0;               ///< Mean over all places.
  std::vector<CoveragePlace> places;  ///< Row by row.
  std::vector<WantedPose> poses;      ///< The most useful first; fewer if nothing is missing.
};

/// Corners of the box that a scene's surfels fill, without the outermost 0.1 % on each side.
struct SceneBox {
  glm::dvec3 low_m{0.0}, high_m{0.0};
};
[[nodiscard]] SceneBox scene_box(const renderer::SurfelCloud& surfels);

/// @param renderer  Of the scene.
/// @throws core::InputError if there is no room for the robot.
[[nodiscard]] CoverageGuide coverage_guide(core::Renderer& renderer, const sim::World& world,
                                           const SceneBox& box,
                                           const CoverageGuideOptions& options);

/// The places on the plan, from green (all is seen) to red (half is missing), and the wanted
/// poses as numbered arrows.
[[nodiscard]] core::Image<core::Rgb8> coverage_picture(const drawing::FloorPlan& plan,
                                                       const CoverageGuide& guide);

}  // namespace segsim::experiments::scenes
