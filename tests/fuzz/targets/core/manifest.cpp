// scene.yaml of a bundle (core/scene_bundle.h, core/bundle_parts.h). Its files are empty, and
// so is what the manifest may say of their hashes.
#include "core/bundle_parts.h"
#include "core/file_io.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {
namespace {

core::SceneManifest small_manifest() {
  core::SceneManifest m;
  m.name = "room";
  m.created_by = "test";
  m.source = "made up";
  m.origin = {30.263, 120.123, 10.0, 0.25};
  m.robot_radius_m = 0.33;
  m.robot_height_m = 0.3;
  m.camera_height_m = 1.2;
  m.classes = {{1, "chair", true}, {2, "wall", false}};
  m.instances = {{7, 1, "ChairA_01", {0, 0, 0}, {0.5, 0.5, 1.0}}};
  m.surfels.name = "surfels.ply";
  m.collision_mesh.name = "collision.ply";
  m.navmesh.name = "navmesh.bin";
  m.statistics = {{"frames_used", 12.0}};
  return m;
}

void make_files() {
  for (const char* name : {"surfels.ply", "collision.ply", "navmesh.bin", "labels.bin"}) {
    (void)in_file("", name);
  }
}

std::string manifest_with(const core::BundleParts& parts) {
  core::SceneManifest manifest = small_manifest();
  if (parts.rendering_only) manifest.navmesh = {};
  core::write_bundle_manifest(work_folder(), manifest, parts);
  return core::read_file(work_folder() / "scene.yaml");
}

}  // namespace

void parse(const std::string& bytes) {
  static const bool made = (make_files(), true);
  (void)made;
  (void)in_file(bytes, "scene.yaml");
  const core::SceneBundle bundle = core::load_bundle(work_folder());
  const core::BundleParts parts = core::load_bundle_parts(work_folder());
  if (parts.rendering_only) (void)parts.rendering_only->text();
  for (const core::SceneInstance& instance : bundle.manifest.instances) {
    (void)bundle.manifest.class_name(instance.class_id);
  }
}

std::vector<std::string> seeds() {
  make_files();
  core::BundleParts parts;
  parts.mesh_source = "tsdf";
  parts.labels.name = "labels.bin";
  core::BundleParts closed = parts;
  closed.rendering_only = core::RenderingOnly{
      "no floor", "jackal", core::FreeDisc{{1.0, 2.0}, 0.2}, {"turtlebot3-waffle"}};
  return {manifest_with(parts), manifest_with(closed)};
}

}  // namespace segsim::fuzz
