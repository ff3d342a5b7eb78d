#pragma once

/// @file
/// Ground-truth renderer for MeshScene: exact depth, normals and labels by ray casting
/// (Embree), and colours that do not depend on the view.
///
///     colour = tone map(exposure * (emission + albedo texture * irradiance / pi))
///
/// The irradiance of a surface (direct light with soft shadows and one bounce) is kept in a
/// hash of small cells (irradiance_cache.h), so all frames of a capture agree and a frame
/// costs little more than its primary rays once the cells are filled. Limit: no specular
/// light, no transparency.

#include <memory>

#include "core/render.h"
#include "sim/ground/mesh_scene.h"

namespace segsim::worlds {

/// The defaults suit a capture that is used many times. `cell_m` 0.08 and `bounce_samples` 49
/// fill the cache about five times as fast, at the price of softer shadows and some mottling.
struct MeshRenderOptions {
  int threads = 0;           ///< 0 = all cores; 1 = the caller's thread only.
  int samples_per_side = 2;  ///< Colour is the mean of this squared many rays per pixel.
  float cell_m = 0.05F;      ///< Edge of an irradiance cell.
  int shadow_samples = 12;   ///< Per cell and lamp that matters there.
  int bounce_samples = 100;  ///< Per cell.
  float exposure = 0.0F;     ///< Factor on radiance; 0 = chosen from the scene's irradiance.
  glm::vec3 sky{0.75F, 0.85F,
                1.0F};  ///< Linear radiance after exposure where a ray hits nothing.
};

/// Renderer of `scene`, which is copied where needed and may go away. Colour is deterministic:
/// it depends neither on the number of threads nor on earlier frames. Frame: depth along +z
/// and NaN where nothing is hit; geometric normals towards the camera; alpha 1 or 0;
/// confidence 1 where something is hit.
/// @throws ContractViolation if an option is out of range or a mesh refers to a missing
/// material, texture or vertex.
[[nodiscard]] std::unique_ptr<core::Renderer> make_mesh_renderer(
    const sim::MeshScene& scene, const MeshRenderOptions& options = {});

}  // namespace segsim::worlds
