#include "experiments/scenes/bundle_shape.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/error.h"
#include "core/progress.h"
#include "experiments/scenes/robot_room.h"
#include "worlds/surface/bundle_files.h"
#include "worlds/surface/mesh_cleaning.h"

namespace segsim::experiments::scenes {

MeshSource parse_mesh_source(const std::string& word, const std::string& place) {
  if (word == "auto") return MeshSource::kAuto;
  if (word == "lifted") return MeshSource::kLifted;
  if (word == "depth") return MeshSource::kDepth;
  throw core::InputError::expected(place, "auto | lifted | depth", "\"" + word + "\"");
}

SceneShape fuse_rendered_depth(core::Renderer& renderer,
                               const core::CameraIntrinsics& intrinsics,
                               std::span<const core::CameraPose> poses,
                               const SurfaceOptions& options) {
  core::CameraIntrinsics camera = intrinsics;
  if (camera.width_px > options.max_width_px) {
    const double scale = static_cast<double>(options.max_width_px) / camera.width_px;
    camera =
        camera.resized(options.max_width_px,
                       std::max(1, static_cast<int>(std::lround(camera.height_px * scale))));
  }
  SceneShape shape;
  worlds::DepthFusion fusion(options.fusion);
  core::Progress progress("fuse depth", 2 * static_cast<std::int64_t>(poses.size()));
  std::int64_t done = 0;
  // All are reserved before the first is added. Meanwhile they are kept, as far as memory
  // goes, and drawn again where it does not.
  constexpr std::size_t kKept_bytes = std::size_t{512} << 20U;
  const std::size_t frame_bytes = static_cast<std::size_t>(camera.width_px) *
                                  static_cast<std::size_t>(camera.height_px) *
                                  (2 * sizeof(float) + sizeof(glm::vec3));  // With alpha.
  std::vector<core::Frame> kept(std::min(poses.size(), kKept_bytes / frame_bytes));
  core::Frame other;
  for (const bool adding : {false, true}) {
    for (std::size_t i = 0; i < poses.size(); ++i) {
      core::Frame& frame = i < kept.size() ? kept[i] : other;
      if (!adding || i >= kept.size()) {
        renderer.render(poses[i], camera, core::Channels::kDepth | core::Channels::kNormal,
                        frame);
      }
      const worlds::DepthView view{camera, poses[i], &frame.depth_m, &frame.normal};
      adding ? fusion.add_reserved(view) : fusion.reserve(view);
      progress.update(++done);
    }
  }
  for (const core::CameraPose& pose : poses) {
    shape.camera_positions_m.push_back(pose.translation_m());
  }
  progress.finish();
  shape.surface = fusion.surface();
  const std::size_t pieces = worlds::remove_small_pieces(shape.surface, options.min_piece_m2);
  const worlds::EdgeCounts edges = worlds::count_edges(shape.surface);
  shape.source = "fused depth of " + std::to_string(poses.size()) + " rendered views";
  shape.statistics = {
      {"surface_voxel_m", options.fusion.voxel_m},
      {"surface_megabytes", static_cast<double>(fusion.bytes()) / 1e6},
      {"surface_triangles", static_cast<double>(shape.surface.triangles.size())},
      {"surface_pieces_removed", static_cast<double>(pieces)},
      {"surface_open_edge_share",
       static_cast<double>(edges.open + edges.irregular) /
           std::max<double>(1.0, static_cast<double>(edges.total()))}};
  return shape;
}

core::SceneLevelling level_shape(SceneShape& shape, const worlds::LevellingOptions& options) {
  const auto found = shape.points_m.empty()
                         ? worlds::find_levelling(shape.surface, options)
                         : worlds::find_levelling(shape.points_m, shape.normals, options);
  if (!found) {
    shape.warnings.emplace_back(
        "no level plane stands out near z = 0: the scene stays in the recording's own frame");
    return {};
  }
  shape.statistics.emplace_back("levelled_from_height_m", found->height_m);
  shape.statistics.emplace_back("levelled_from_tilt_rad", found->tilt_rad);
  shape.statistics.emplace_back("levelled", found->applied ? 1.0 : 0.0);
  if (!found->applied) return {};
  const core::SceneLevelling levelling{found->R_level, found->t_level_m};
  move_shape(levelling, shape);
  return levelling;
}

void move_shape(const core::SceneLevelling& levelling, SceneShape& shape) {
  const glm::dquat& R = levelling.R_world_source;
  const glm::dvec3& t_m = levelling.p_world_source_m;
  for (auto* points_m : {&shape.points_m, &shape.surface.positions_m}) {
    for (glm::vec3& p : *points_m) p = glm::vec3(R * glm::dvec3(p) + t_m);
  }
  for (glm::vec3& n : shape.normals) n = glm::vec3(R * glm::dvec3(n));
  for (glm::dvec3& p : shape.camera_positions_m) p = R * p + t_m;
}

void move_cameras(const core::SceneLevelling& levelling, core::CameraPath& cameras) {
  const core::Transform<core::frame::World, core::frame::World> T_world_source(
      levelling.R_world_source, levelling.p_world_source_m);
  for (core::CameraPath::View& view : cameras.views) {
    view.T_world_camera = T_world_source * view.T_world_camera;
  }
}

void decimate_shape(SceneShape& shape, double max_error_m) {
  if (shape.surface.triangles.empty()) return;
  shape.surface = worlds::decimated(shape.surface, max_error_m);
  shape.statistics.emplace_back("surface_triangles_decimated",
                                static_cast<double>(shape.surface.triangles.size()));
}

namespace {

worlds::CollisionMeshResult collision_mesh_of(const SceneShape& shape,
                                              const worlds::CollisionMeshOptions& options) {
  if (!shape.surface.triangles.empty()) {
    return worlds::collision_mesh_of_surface(shape.surface, shape.camera_positions_m, options);
  }
  if (shape.points_m.empty()) {
    throw core::InputError::expected("reconstruction", "a surface that several views agree on",
                                     "none in " + shape.source);
  }
  return worlds::make_collision_mesh(shape.points_m, shape.normals, shape.camera_positions_m,
                                     options);
}

}  // namespace

std::vector<std::string> write_shape(const std::filesystem::path& folder,
                                     const SceneShape& shape, const sim::RobotModel& robot,
                                     const worlds::CollisionMeshOptions& options,
                                     core::SceneManifest& manifest, core::BundleParts& parts) {
  std::vector<std::string> warnings = shape.warnings;
  const auto add_statistics = [&](const auto& listing) {
    manifest.statistics.insert(manifest.statistics.end(), listing.begin(), listing.end());
  };
  const auto nothing_drives = [&](core::RenderingOnly why) {
    warnings.push_back(
        "nothing can drive here, the bundle is for rendering and labels only: " + why.text());
    parts.rendering_only = std::move(why);
    return warnings;
  };
  manifest.collision_mesh = manifest.navmesh = {};
  manifest.robot_radius_m = manifest.robot_height_m = 0.0;
  parts.mesh_source = shape.source;
  parts.rendering_only.reset();
  add_statistics(shape.statistics);
  worlds::CollisionMeshResult collision;
  try {
    collision = collision_mesh_of(shape, options);
  } catch (const core::InputError& error) {
    return nothing_drives({error.what(), robot.name, std::nullopt, {}});
  }
  warnings.insert(warnings.end(), collision.warnings.begin(), collision.warnings.end());
  add_statistics(collision.statistics());
  worlds::write_collision_mesh(folder, collision.mesh, manifest);
  auto room = find_room(collision.mesh, robot);
  if (auto* none = std::get_if<core::RenderingOnly>(&room)) return nothing_drives(*none);
  worlds::write_navmesh(folder, std::get<sim::World>(room).navmesh(), manifest);
  return warnings;
}

}  // namespace segsim::experiments::scenes
