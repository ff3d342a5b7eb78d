#pragma once

/// @file
/// From what a reconstruction looks like to what a robot can drive in: depth is rendered from
/// the surfels and fused to a surface, the floor is levelled, and the collision mesh made.

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <glm/vec3.hpp>

#include "core/bundle_parts.h"
#include "core/camera_path.h"
#include "core/frames.h"
#include "core/render.h"
#include "core/scene_bundle.h"
#include "sim/ground/robot.h"
#include "sim/ground/triangle_mesh.h"
#include "worlds/surface/collision_mesh.h"
#include "worlds/surface/depth_fusion.h"
#include "worlds/surface/levelling.h"

namespace segsim::experiments::scenes {

/// What a collision mesh is made from.
enum class MeshSource : unsigned char {
  kAuto,    ///< kDepth for trained scenes, kLifted for others.
  kLifted,  ///< The lifted surfels' centres.
  kDepth,   ///< Depth rendered from the scene's surfels, fused.
};

/// @throws core::InputError for another word than "auto", "lifted" or "depth".
[[nodiscard]] MeshSource parse_mesh_source(const std::string& word, const std::string& place);

/// Truncation in voxels that the program uses.
inline constexpr double kTruncationVoxels = 8.0 / 3.0;

struct SurfaceOptions {
  worlds::DepthFusionOptions fusion;
  double min_piece_m2 = 0.1;  ///< Smaller connected pieces are floaters.
  double max_error_m = 0.01;  ///< Of decimation; 0: none.
  int max_width_px = 320;     ///< Views are rendered no wider.
};

/// Where the surfaces of a scene are, by either source.
struct SceneShape {
  std::vector<glm::vec3> points_m, normals;  ///< Empty if there is a surface.
  sim::TriangleMesh surface;
  std::vector<glm::dvec3> camera_positions_m;
  std::string source;  ///< For BundleParts::mesh_source.
  std::vector<std::pair<std::string, double>> statistics;
  std::vector<std::string> warnings;
};

/// Renders depth and normals from the poses, fuses them and removes floaters. Shows progress.
[[nodiscard]] SceneShape fuse_rendered_depth(core::Renderer& renderer,
                                             const core::CameraIntrinsics& intrinsics,
                                             std::span<const core::CameraPose> poses,
                                             const SurfaceOptions& options);

/// Brings the floor of the shape to z = 0, if one is found and it is not there already. If
/// none is found, the shape stays in the recording's own frame, with a warning.
/// @return  What the rest of the scene must follow; the identity if nothing was moved.
core::SceneLevelling level_shape(SceneShape& shape,
                                 const worlds::LevellingOptions& options = {});

/// The shape goes along.
void move_shape(const core::SceneLevelling& levelling, SceneShape& shape);

/// The cameras go along.
void move_cameras(const core::SceneLevelling& levelling, core::CameraPath& cameras);

/// Fewer triangles, for a shape with a surface.
void decimate_shape(SceneShape& shape, double max_error_m);

/// Writes collision.ply and navmesh.bin, and what is known of them into manifest and parts. A
/// shape without floor or room for the robot takes nothing else away: the parts then say why
/// there is no navmesh, and without floor no collision mesh.
/// @return  Warnings, that reason among them.
std::vector<std::string> write_shape(const std::filesystem::path& folder,
                                     const SceneShape& shape, const sim::RobotModel& robot,
                                     const worlds::CollisionMeshOptions& options,
                                     core::SceneManifest& manifest, core::BundleParts& parts);

}  // namespace segsim::experiments::scenes
