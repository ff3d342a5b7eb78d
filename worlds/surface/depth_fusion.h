#pragma once

/// @file
/// Posed depth images -> one surface.
///
///   depth images -> truncated signed distances on sparse blocks of voxels -> marching cubes
///
/// A voxel keeps the weighted mean of its signed distances to the surfaces that views saw near
/// it (Curless & Levoy 1996, "A volumetric method for building complex models from range
/// images"), in blocks of 8 x 8 x 8 that exist only near surfaces (Niessner et al. 2013,
/// "Real-time 3D reconstruction at scale using voxel hashing"). Distances are taken to the
/// plane of the surface at the pixel, so that a slanted surface is not thickened, and count
/// less the deeper the voxel lies behind it (after Bylow et al. 2013, but with the square), so
/// that the two faces of a door do not push each other apart.
///
/// What no view has seen is unknown and gets no surface: the mesh is closed where everything
/// around it was seen, and ends in an open edge where knowledge ends. Nothing is invented
/// behind or under furniture; worlds/surface/collision_mesh.h closes the floor there.
///
/// Equal views in equal order give equal meshes, whatever the number of threads.

#include <cstddef>
#include <memory>

#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::worlds {

struct DepthFusionOptions {
  double voxel_m = 0.03;
  /// Distances beyond are cut off; at least two voxels. A wall thinner than this may lose the
  /// face that fewer views saw.
  double truncation_m = 0.08;
  double min_depth_m = 0.1, max_depth_m = 8.0;  ///< Pixels outside are not used.
  double max_grazing_deg = 80.0;  ///< Largest angle between surface normal and line of sight.
  /// Views, weighted with the cosine of that angle, that a piece of surface needs.
  double min_weight = 1.5;
  /// Memory bound: a block takes 4 KiB. The default is 4 GiB, about 9000 m2 of surface.
  std::size_t max_blocks = std::size_t{1} << 20U;
  int threads = 0;  ///< 0 = all processors.
};

/// One view; images are of the camera's size.
struct DepthView {
  core::CameraIntrinsics intrinsics;
  core::CameraPose T_world_camera;
  /// Along +z. What is not a finite positive number is unknown.
  const core::Image<float>* depth_m = nullptr;
  /// World frame, unit, towards the camera; 0 = unknown. nullptr: found from the depth.
  const core::Image<glm::vec3>* normal = nullptr;
};

class DepthFusion {
 public:
  /// @throws core::ContractViolation for options out of range.
  explicit DepthFusion(const DepthFusionOptions& options = {});
  ~DepthFusion();
  DepthFusion(DepthFusion&&) noexcept;
  DepthFusion& operator=(DepthFusion&&) noexcept;

  /// Makes room for what a view sees, without looking at its distances. If all views are
  /// reserved before the first is added, every view testifies to the free space in front of
  /// every surface; without, a surface that appears late has missed the views before it.
  /// @throws as add().
  void reserve(const DepthView& view);

  /// @throws core::InputError if the surface needs more than max_blocks or lies more than
  ///     10 km from the origin; core::ContractViolation for images of another size.
  void add(const DepthView& view);
  /// The same of a view that reserve() was told of: room is not looked for again.
  void add_reserved(const DepthView& view);

  [[nodiscard]] std::size_t block_count() const;
  [[nodiscard]] std::size_t bytes() const;

  /// The surface so far; triangles face the side that was seen as free. Every inner edge
  /// belongs to two triangles. Empty if nothing was seen often enough.
  [[nodiscard]] sim::TriangleMesh surface() const;

 private:
  struct Volume;
  std::unique_ptr<Volume> volume_;
};

}  // namespace segsim::worlds
