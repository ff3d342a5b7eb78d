#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <string>

#include <CLI/CLI.hpp>
#include <glm/geometric.hpp>

#include "core/bundle_parts.h"
#include "core/scene_bundle.h"
#include "experiments/commands/scene/scene_commands.h"
#include "experiments/scenes/coverage.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/scenes/viewed_place.h"
#include "experiments/training/training_folder.h"
#include "sim/ground/robot.h"
#include "sim/ground/world.h"

namespace segsim::experiments::commands::scene {
namespace {

std::string labels_in_words(const scenes::SceneSurfels& scene) {
  if (!scene.labels) return scene.surfels->has_labels() ? "one per surfel" : "none";
  char text[160];
  std::snprintf(
      text, sizeof text,
      "distributions of %zu classes and %zu instances, %zu and %zu at most of a surfel",
      scene.labels->class_id.size(), scene.labels->instance_id.size(),
      scene.labels->classes.row_capacity(), scene.labels->instances.row_capacity());
  return text;
}

/// Empty without labels set by hand.
std::string edits_in_words(const core::SceneBundle& bundle, const core::BundleParts& parts,
                           std::size_t surfels) {
  if (parts.label_edits.name.empty()) return {};
  const renderer::LabelEdits edits =
      renderer::read_label_edits(bundle.folder / parts.label_edits.name, surfels);
  std::size_t by_hand = 0;
  for (const renderer::LabelEdits::Run& run : edits.runs) by_hand += run.count;
  return "set by hand of " + std::to_string(by_hand) + " surfels (segsim scene label)";
}

std::string levelling_in_words(const core::SceneLevelling& levelling) {
  const glm::dquat& R = levelling.R_world_source;
  const double tilt_rad = 2.0 * std::atan2(std::hypot(R.x, R.y, R.z), std::abs(R.w));
  const double lift_m = glm::length(levelling.p_world_source_m);
  if (tilt_rad == 0.0 && lift_m == 0.0) return "as recorded";
  char text[96];
  std::snprintf(text, sizeof text, "turned by %.2f deg, moved by %.1f cm",
                tilt_rad / std::numbers::pi * 180.0, 100.0 * lift_m);
  return text;
}

void inspect_training(const std::filesystem::path& folder) {
  const scenes::ViewedPlace place = scenes::open_viewed_place(folder);
  const renderer::SurfelCloud& surfels = *place.scene.surfels;
  std::printf("folder         %s\n", folder.string().c_str());
  std::printf("unfinished     a training that has no bundle yet: %s\n",
              training::training_progress(folder).c_str());
  std::printf("surfels        %zu, SH degree %d, %s\n", surfels.size(), surfels.sh_degree,
              surfels.has_labels() ? "labelled" : "without labels");
  std::printf("views          %zu\n", place.cameras->views.size());
  std::printf("look at it     segsim render %s --view 0 --out view.png\n",
              folder.string().c_str());
}

void print_rendering_only(const core::RenderingOnly& only) {
  std::printf("to drive in    no: for rendering and labels only\n");
  std::printf("reason         %s\n", only.reason.c_str());
  std::printf("looked for     the room of %s\n", only.robot.c_str());
  if (only.free_disc) {
    const core::FreeDisc& disc = *only.free_disc;
    std::printf("free disc      the largest has a radius of %.3f m, at (%.2f, %.2f) m\n",
                disc.radius_m, disc.center_m.x, disc.center_m.y);
  } else {
    std::printf("free disc      none\n");
  }
  std::string robots;
  for (const std::string& name : only.fitting) robots += (robots.empty() ? "" : ", ") + name;
  std::printf("room for       %s\n", robots.empty() ? "none" : robots.c_str());
}

void print_free_space(const sim::World& world, const std::string& mesh_source) {
  std::printf("collision mesh %zu triangles, from %s\n", world.mesh().triangles.size(),
              mesh_source.empty() ? "an unknown source" : mesh_source.c_str());
  std::printf("free space     %.1f m2 for a robot of radius %.3f m\n",
              world.free_space().area_m2(1), world.free_space().radius_m);
}

void inspect(const std::filesystem::path& folder, const std::string& robot_name) {
  if (training::is_training_folder(folder)) {
    inspect_training(folder);
    return;
  }
  const core::SceneBundle bundle = core::load_bundle(folder);
  const core::SceneManifest& m = bundle.manifest;
  const core::BundleParts parts = core::load_bundle_parts(folder);
  const scenes::SceneSurfels scene = scenes::load_scene_surfels(bundle);
  const renderer::SurfelCloud& surfels = *scene.surfels;
  std::optional<sim::World> world;
  if (!parts.rendering_only) {
    world = sim::World::load(bundle, sim::RobotModel::by_name(robot_name));
  }

  std::printf("scene          %s\n", m.name.c_str());
  std::printf("folder         %s\n", folder.string().c_str());
  std::printf("sha256         %s\n", bundle.scene_sha256.c_str());
  std::printf("version        %d\n", parts.version);
  std::printf("made by        %s\n", m.created_by.c_str());
  std::printf("from           %s\n", m.source.c_str());
  std::printf(
      "origin         latitude %.7f deg, longitude %.7f deg, height %.2f m, yaw %.4f rad\n",
      m.origin.latitude_deg, m.origin.longitude_deg, m.origin.height_m, m.origin.yaw_rad);
  std::printf("camera height  %.2f m\n", m.camera_height_m);
  std::printf("surfels        %zu, SH degree %d, %s\n", surfels.size(), surfels.sh_degree,
              surfels.has_labels() ? "labelled" : "without labels");
  std::printf("labels         %s\n", labels_in_words(scene).c_str());
  if (const std::string edits = edits_in_words(bundle, parts, surfels.size());
      !edits.empty()) {
    std::printf("label edits    %s\n", edits.c_str());
  }
  std::printf("levelled       %s\n", levelling_in_words(parts.levelling).c_str());
  parts.rendering_only ? print_rendering_only(*parts.rendering_only)
                       : print_free_space(*world, parts.mesh_source);

  std::map<std::uint16_t, std::size_t> surfels_of_class;
  for (const std::uint16_t id : surfels.semantic_id) ++surfels_of_class[id];
  std::printf("\n%5s  %-18s %-6s %9s %10s\n", "class", "name", "kind", "instances", "surfels");
  for (const core::SceneClass& c : m.classes) {
    const auto instances = std::count_if(
        m.instances.begin(), m.instances.end(),
        [&](const core::SceneInstance& instance) { return instance.class_id == c.id; });
    std::printf("%5d  %-18s %-6s %9ld %10zu\n", c.id, c.name.c_str(),
                c.thing ? "thing" : "stuff", static_cast<long>(instances),
                surfels_of_class[c.id]);
  }
  std::printf("\nunlabelled surfels: %zu\n\nstatistics\n", surfels_of_class[0]);
  for (const auto& [key, value] : m.statistics)
    std::printf("  %-28s %g\n", key.c_str(), value);
  const std::string credits = scenes::read_credits(folder);
  if (!credits.empty()) std::printf("\nmakers and licences\n%s", credits.c_str());
  const std::string warning = scenes::coverage_warning(m);
  if (!warning.empty()) std::printf("\nwarning: %s\n", warning.c_str());
}

}  // namespace

void add_scene_command(CLI::App& app) {
  CLI::App* scene = light::add_listed(app, light::kCommands, "scene");
  scene->require_subcommand(1);

  struct Flags {
    std::filesystem::path folder;
    std::string robot = "jackal-gentle";
  };
  auto flags = std::make_shared<Flags>();
  CLI::App* command = scene->add_subcommand(
      "inspect", "Check a bundle and print what it holds; a damaged one is refused");
  command
      ->add_option("bundle", flags->folder,
                   "Folder with scene.yaml, or OUT.training of an unfinished training")
      ->required();
  command->add_option("--robot", flags->robot, "Robot whose free space is reported")
      ->capture_default_str();
  command->callback([flags] { inspect(flags->folder, flags->robot); });
  add_scene_mesh(*scene);
  add_scene_coverage(*scene);
  add_scene_query(*scene);
  add_scene_label(*scene);
}

}  // namespace segsim::experiments::commands::scene
