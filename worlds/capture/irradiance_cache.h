#pragma once

/// @file
/// Diffuse light on the surfaces of a scene, remembered per small cell.
///
/// A cell is a cube of `cell_m` and one of six directions. Its value is computed on first use,
/// at the surface of that cell and direction, from numbers that are seeded by the cell's key:
/// who asks first, from where and on which thread does not matter. Between cells the value is
/// interpolated along the surface. A value holds the irradiance for the cell's own normal and
/// the mean direction of the light, by which it is adapted to the normal that is asked for, so
/// that round things look round.

#include <cstdint>
#include <memory>
#include <vector>

#include <glm/vec3.hpp>

#include "sim/ground/mesh_scene.h"
#include "sim/ground/ray_scene.h"
#include "worlds/capture/surface_shading.h"

namespace segsim::worlds {

struct IrradianceOptions {
  float cell_m = 0.05F;
  int shadow_samples = 12;
  int bounce_samples = 100;
};

class IrradianceCache {
 public:
  /// `rays` and `surfaces` are of the same scene and must outlive the cache.
  IrradianceCache(const sim::MeshScene& scene, const sim::RayScene& rays,
                  const SurfaceShading& surfaces, const IrradianceOptions& options);
  ~IrradianceCache();
  IrradianceCache(const IrradianceCache&) = delete;
  IrradianceCache& operator=(const IrradianceCache&) = delete;

  /// Irradiance (linear RGB) of a surface point. Thread-safe.
  /// @param face_normal  Unit, geometric, towards the viewer. @param normal  Unit, for
  /// shading.
  [[nodiscard]] glm::vec3 at(const glm::vec3& point_m, const glm::vec3& face_normal,
                             const glm::vec3& normal) const;

  /// Median irradiance of points spread evenly over the lit surfaces; 0 if nothing is lit.
  [[nodiscard]] float median_irradiance() const { return median_irradiance_; }

 private:
  struct Cell;
  struct Cells;
  struct Key;

  [[nodiscard]] const Cell& cell(const Key& key) const;
  [[nodiscard]] Cell compute(const Key& key) const;
  [[nodiscard]] float find_median(const sim::MeshScene& scene) const;

  const sim::RayScene& rays_;
  const SurfaceShading& surfaces_;
  std::vector<sim::PointLight> lights_;
  IrradianceOptions options_;
  float median_irradiance_ = 0.0F;
  std::unique_ptr<Cells> cells_;
};

}  // namespace segsim::worlds
