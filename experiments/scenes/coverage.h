#pragma once

/// @file
/// Does the reconstruction cover what a robot will look at? It looks from other places than
/// the recording did, and holes become dark places that no detector was trained on.

#include <string>
#include <utility>
#include <vector>

#include <glm/vec2.hpp>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "sim/ground/world.h"

namespace segsim::experiments::scenes {

struct RobotCoverage {
  int views = 0;
  double mean_alpha = 0.0;  ///< Over pixels of all views.
  int thin_views = 0;       ///< With a mean alpha below kMinCoverage.

  [[nodiscard]] std::vector<std::pair<std::string, double>> listing() const;
};

inline constexpr double kMinCoverage = 0.6;
inline constexpr double kMaxThinShare = 0.1;

/// Centres of the cells of the free space that a robot can drive between.
/// @throws core::InputError if there are none.
[[nodiscard]] std::vector<glm::dvec2> reachable_cells_m(const sim::World& world);

/// Views from random places of the free space, all around, level, at the scene's camera
/// height.
/// @param renderer  Of the scene.
[[nodiscard]] RobotCoverage robot_coverage(core::Renderer& renderer, const sim::World& world,
                                           double camera_height_m, int views = 64);

/// A warning if the statistics of a scene say that it covers too little; else empty.
[[nodiscard]] std::string coverage_warning(const core::SceneManifest& manifest);

}  // namespace segsim::experiments::scenes
