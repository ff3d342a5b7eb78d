#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <unistd.h>

#include <CLI/CLI.hpp>

#include "core/bundle_parts.h"
#include "core/error.h"
#include "core/version.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/commands/scene/scene_commands.h"
#include "experiments/scenes/bundle_folder.h"
#include "experiments/scenes/bundle_shape.h"
#include "experiments/scenes/coverage.h"
#include "experiments/scenes/mesh_accuracy.h"
#include "experiments/scenes/mesh_source.h"
#include "experiments/scenes/robot_room.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/support/record_file.h"
#include "reconstruction/lifting/lifting.h"
#include "renderer/files/panoptic_field_file.h"
#include "renderer/files/ply_io.h"
#include "renderer/renderer_backend.h"
#include "renderer/scene/surfel_transform.h"
#include "worlds/mesh/mesh_import.h"
#include "worlds/mesh/plain_mesh.h"
#include "worlds/procedural/procedural_flat.h"
#include "worlds/surface/mesh_distance.h"

namespace segsim::experiments::commands::scene {
namespace {

namespace fs = std::filesystem;

struct RemeshFlags {
  fs::path bundle, out;
  std::string robot = "jackal-gentle", backend = "cpu";
  std::size_t frame_step = 1;
  double floor_height_m = 0.0;
  bool floor_given = false;
  scenes::SurfaceOptions surface;
};

/// Statistics of the old mesh would contradict the new ones.
void drop_shape_statistics(core::SceneManifest& manifest) {
  std::erase_if(manifest.statistics, [](const auto& entry) {
    for (const char* prefix :
         {"collision_", "floor_", "navmesh_", "surface_", "levelled", "robot_view"}) {
      if (entry.first.starts_with(prefix)) return true;
    }
    return false;
  });
}

core::CameraPath cameras_of(const core::SceneBundle& bundle, const core::BundleParts& parts) {
  if (parts.cameras.name.empty()) {
    throw core::InputError::expected(
        (bundle.folder / core::kCamerasFileName).string(),
        "the recording's cameras (`segsim reconstruct` writes them)", "none");
  }
  return core::read_camera_path(bundle.folder / parts.cameras.name);
}

/// To the floor that is given, then to the one that is found there.
core::SceneLevelling level(scenes::SceneShape& shape, const RemeshFlags& flags) {
  const core::SceneLevelling given{{1.0, 0.0, 0.0, 0.0}, {0.0, 0.0, -flags.floor_height_m}};
  scenes::move_shape(given, shape);
  const core::SceneLevelling found = scenes::level_shape(shape);
  return {found.R_world_source,
          found.R_world_source * given.p_world_source_m + found.p_world_source_m};
}

/// Writes the parts of a bundle whose surfels may have moved.
void write_remeshed(const fs::path& folder, const RemeshFlags& flags,
                    const core::SceneBundle& bundle) {
  core::SceneManifest manifest = bundle.manifest;
  core::BundleParts parts = core::load_bundle_parts(bundle.folder);
  parts.label_edits = {};  // They become the new bundle's own labels.
  const scenes::SceneSurfels scene = scenes::load_scene_surfels(bundle);
  core::CameraPath cameras = cameras_of(bundle, parts);
  std::vector<core::CameraPose> poses;
  for (std::size_t i = 0; i < cameras.views.size(); i += flags.frame_step) {
    poses.push_back(cameras.views[i].T_world_camera);
  }
  const auto renderer =
      renderer::make_renderer(renderer::backend_of(flags.backend), scene.surfels);
  scenes::SceneShape shape =
      scenes::fuse_rendered_depth(*renderer, cameras.intrinsics, poses, flags.surface);
  const core::SceneLevelling step = level(shape, flags);
  scenes::move_cameras(step, cameras);
  core::write_camera_path(folder / parts.cameras.name, cameras);
  scenes::decimate_shape(shape, flags.surface.max_error_m);

  renderer::SurfelCloud surfels = *scene.surfels;
  renderer::transform_surfels(step.R_world_source, step.p_world_source_m, surfels);
  manifest.instances = reconstruction::instance_boxes(surfels, manifest.instances);
  manifest.created_by = std::string("segsim ") + core::version();
  drop_shape_statistics(manifest);
  renderer::write_surfels_ply(folder / manifest.surfels.name, surfels);
  if (scene.labels) {
    renderer::write_panoptic_field(folder / parts.labels.name, *scene.labels);
  }
  if (const fs::path model = bundle.folder / renderer::kPanopticFileName; fs::exists(model)) {
    renderer::PanopticModel moved = renderer::read_panoptic_model(model);
    renderer::transform_panoptic_model(step.R_world_source, step.p_world_source_m, moved);
    renderer::write_panoptic_model(folder / renderer::kPanopticFileName, moved);
  }
  const auto robot = sim::RobotModel::by_name(flags.robot);
  worlds::CollisionMeshOptions options;
  options.floor_is_known = flags.floor_given;
  for (const std::string& warning :
       scenes::write_shape(folder, shape, robot, options, manifest, parts)) {
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  }
  parts.levelling = {
      step.R_world_source * parts.levelling.R_world_source,
      step.R_world_source * parts.levelling.p_world_source_m + step.p_world_source_m};
  if (const fs::path credits = bundle.folder / scenes::kCreditsFileName; fs::exists(credits)) {
    fs::copy_file(credits, folder / scenes::kCreditsFileName);
  }
  core::write_bundle_manifest(folder, manifest, parts);
}

void remesh(const RemeshFlags& flags) {
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  scenes::write_bundle_folder(
      flags.out, [&](const fs::path& folder) { write_remeshed(folder, flags, bundle); });
  static_cast<void>(core::load_bundle(flags.out));
  std::printf("%s: see `segsim scene inspect`\n", flags.out.string().c_str());
}

struct ErrorFlags {
  fs::path bundle, mesh, record;
  std::string robot = "jackal-gentle";
  std::uint64_t flat = 0;
  bool flat_given = false;
};

void mesh_error(const ErrorFlags& flags) {
  if (flags.flat_given != flags.mesh.empty()) {
    throw core::InputError::expected("scene mesh-error", "one of --flat and --mesh",
                                     flags.flat_given ? "both" : "neither");
  }
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  if (bundle.manifest.collision_mesh.name.empty()) core::require_drivable(bundle);
  const core::SceneLevelling levelling = core::load_bundle_parts(flags.bundle).levelling;
  specs::SourceSpec source;
  source.type = flags.flat_given ? specs::SourceType::kFlat : specs::SourceType::kMesh;
  source.seed = flags.flat;
  source.world = flags.mesh;
  sim::TriangleMesh truth = worlds::plain_mesh(scenes::load_mesh_source(source));
  for (glm::vec3& p : truth.positions_m) {
    p = glm::vec3(levelling.R_world_source * glm::dvec3(p) + levelling.p_world_source_m);
  }
  const sim::TriangleMesh found = sim::read_mesh_ply(bundle.collision_mesh_file());
  const scenes::MeshAccuracy accuracy =
      scenes::mesh_accuracy(found, truth, sim::RobotModel::by_name(flags.robot));
  std::printf("%s", accuracy.text().c_str());
  support::save_record(flags.record, accuracy.record(bundle.manifest.name));
}

void add_remesh(CLI::App& scene) {
  auto flags = std::make_shared<RemeshFlags>();
  CLI::App* command = scene.add_subcommand(
      "remesh",
      "Make the collision mesh anew from depth rendered where the recording's cameras were");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command->add_option("--out", flags->out, "Folder of the new bundle")->required();
  command->add_option("--robot", flags->robot, "Whose navigation mesh is made")
      ->capture_default_str();
  command
      ->add_option("--floor-height", flags->floor_height_m,
                   "Where the floor is in the bundle [m], if it was not found")
      ->check(light::coordinate())
      ->each([flags](const std::string&) { flags->floor_given = true; });
  command->add_option("--backend", flags->backend, "cpu | cuda | auto")->capture_default_str();
  command->add_option("--frame-step", flags->frame_step, "Use every n-th camera")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_option("--voxel", flags->surface.fusion.voxel_m, "Of the fused surface [m]")
      ->check(CLI::Range(0.005, 0.2))
      ->capture_default_str();
  command->callback([flags] {
    flags->surface.fusion.truncation_m =
        scenes::kTruncationVoxels * flags->surface.fusion.voxel_m;
    remesh(*flags);
  });
}

void add_navmesh(CLI::App& scene) {
  struct Flags {
    fs::path bundle;
    std::string robot = "jackal-gentle";
  };
  auto flags = std::make_shared<Flags>();
  CLI::App* command = scene.add_subcommand(
      "navmesh", "Look for room again in a bundle for rendering and labels only");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command
      ->add_option("--robot", flags->robot,
                   "Name, or a file (YAML) with another size or ground clearance")
      ->capture_default_str();
  command->callback([flags] {
    const core::SceneBundle bundle = scenes::add_navmesh(
        core::load_bundle(flags->bundle), sim::RobotModel::by_name(flags->robot));
    std::printf("%s: %s can drive there (radius %.2f m, height %.2f m)\n",
                flags->bundle.string().c_str(), flags->robot.c_str(),
                bundle.manifest.robot_radius_m, bundle.manifest.robot_height_m);
  });
}

void add_mesh_error(CLI::App& scene) {
  auto flags = std::make_shared<ErrorFlags>();
  CLI::App* command = scene.add_subcommand(
      "mesh-error", "Measure a bundle's collision mesh against the world it was captured in");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command->add_option("--flat", flags->flat, "Seed of the procedural flat")
      ->each([flags](const std::string&) { flags->flat_given = true; });
  command->add_option("--mesh", flags->mesh, "Mesh file of the true world");
  command->add_option("--robot", flags->robot, "Whose free floor is compared")
      ->capture_default_str();
  command->add_option("--record", flags->record, support::kRecordHelp);
  command->callback([flags] { mesh_error(*flags); });
}

}  // namespace

void add_scene_mesh(CLI::App& scene) {
  add_navmesh(scene);
  add_remesh(scene);
  add_mesh_error(scene);
}

}  // namespace segsim::experiments::commands::scene
