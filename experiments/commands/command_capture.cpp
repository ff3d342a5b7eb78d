#include <cstdio>
#include <filesystem>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "experiments/commands/commands.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/scenes/mesh_source.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/specs/gazebo_spec.h"
#include "experiments/specs/home_spec.h"
#include "experiments/support/stop_signal.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct Flags {
  fs::path world, mesh, out, trajectory;
  std::int64_t flat_seed = -1, home_seed = -1;
  std::string plan = "any", furniture = "train";
  std::string on_missing = "error", ceiling = "walls";
  specs::SourceSpec source;
  bool exr = false, overwrite = false, classes = false;
};

/// What became of the names of a world's objects, and how to correct it.
void print_classes(const sim::MeshScene& scene) {
  support::internal::TextGrid grid;
  grid.header = {"words of the name", "class", "objects"};
  for (const sim::ClassGuess& guess : scene.class_guesses) {
    grid.rows.push_back(
        {guess.words, scene.classes[guess.class_id - 1U].name, std::to_string(guess.count)});
  }
  std::printf("%s", support::internal::text_of(grid).c_str());
}

void capture(Flags flags) {
  const int given = (flags.world.empty() ? 0 : 1) + (flags.mesh.empty() ? 0 : 1) +
                    (flags.flat_seed < 0 ? 0 : 1) + (flags.home_seed < 0 ? 0 : 1);
  if (given != 1) {
    throw core::InputError::expected("segsim capture",
                                     "one of --world, --mesh, --flat and --home",
                                     std::to_string(given) + " of them");
  }
  specs::SourceSpec& source = flags.source;
  if (flags.flat_seed >= 0) {
    source.type = specs::SourceType::kFlat;
    source.seed = static_cast<std::uint64_t>(flags.flat_seed);
  } else if (flags.home_seed >= 0) {
    source.type = specs::SourceType::kHome;
    source.seed = static_cast<std::uint64_t>(flags.home_seed);
    source.home.plan = worlds::kHomePlanNames.read(flags.plan, "--plan");
    specs::parse_furniture(flags.furniture, "--furniture", source.home);
  } else {
    source.type = flags.world.empty() ? specs::SourceType::kMesh : specs::SourceType::kGazebo;
    source.world = flags.world.empty() ? flags.mesh : flags.world;
    source.gazebo.options.on_missing =
        specs::parse_on_missing(flags.on_missing, "--on-missing");
    source.gazebo.options.ceiling = specs::parse_ceiling(flags.ceiling, "--ceiling");
  }
  if (flags.classes) {
    return print_classes(scenes::load_mesh_source(source, worlds::blank_textures()));
  }
  if (flags.out.empty()) {
    throw core::InputError::expected("segsim capture", "--out, a folder", "none");
  }
  const support::StopOnSignal signals;
  scenes::capture_mesh_source(source, flags.out, flags.trajectory, flags.exr, flags.overwrite);
  std::printf("%s: RGB-D sequence in the 7-Scenes layout with exact labels\n",
              flags.out.string().c_str());
}

}  // namespace

void add_capture_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "capture");
  command->add_option("--world", flags->world, "Gazebo world (.world, .sdf)");
  command->add_option("--mesh", flags->mesh, "Mesh file (.obj, .glb, .dae, .ply, ...)");
  command->add_option("--flat", flags->flat_seed, "Procedural flat of this seed")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--home", flags->home_seed, "Procedural home of this seed")
      ->check(CLI::NonNegativeNumber);
  specs::HomeSpec& home = flags->source.home;
  command->add_option("--plan", flags->plan, "Of a home: any | apartment | office | ward")
      ->capture_default_str();
  command->add_option("--rooms", home.rooms, "Of a home, halls not counted; 0: by the seed")
      ->check(CLI::Range(0, 8))
      ->capture_default_str();
  command
      ->add_option("--furniture", flags->furniture,
                   "Of a home: models of the pool train | unseen | all, or own shapes: own")
      ->capture_default_str();
  command->add_option("--furniture-folder", home.furniture_folder,
                      "Folder with .sh3f files; default: that of Debian's package");
  command->add_option("--out", flags->out, "Folder for the recording");
  worlds::GazeboImportOptions& gazebo = flags->source.gazebo.options;
  command->add_option("--resource-path", gazebo.resource_paths,
                      "Folder with a world's models, meshes or materials (repeatable)");
  command
      ->add_option("--on-missing", flags->on_missing,
                   "About models and meshes that a world lacks: error | collision | skip")
      ->capture_default_str();
  command
      ->add_option("--ceiling", flags->ceiling,
                   "Of a world without one: none | walls (their height) | HEIGHT [m] | "
                   "MODEL@HEIGHT")
      ->capture_default_str();
  command->add_option("--class-map", flags->source.gazebo.class_map,
                      "YAML that corrects the classes that a world's names are taken for");
  command->add_flag("--classes", flags->classes,
                    "Print names and classes of the objects, and capture nothing");
  command->add_option("--trajectory", flags->trajectory,
                      "Poses: 'x y z yaw pitch_down' [m, rad] or TUM lines; default: planned");
  specs::CaptureSpec& capture_spec = flags->source.capture;
  command->add_option("--frames", capture_spec.frames, "Most frames to record; 0: all")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  command->add_option("--width", capture_spec.width_px, "Image width [px]")
      ->check(light::image_side())
      ->capture_default_str();
  command->add_option("--height", capture_spec.height_px, "Image height [px]")
      ->check(light::image_side())
      ->capture_default_str();
  command
      ->add_option("--hfov-deg", capture_spec.hfov_deg, "Horizontal field of view [degrees]")
      ->check(light::field_of_view_deg())
      ->capture_default_str();
  command->add_option("--camera-height", capture_spec.camera_height_m, "Camera height [m]")
      ->check(light::camera_height_m())
      ->capture_default_str();
  command
      ->add_option("--path-seed", flags->source.seed,
                   "Of the planned path; a flat or a home uses its own seed")
      ->capture_default_str();
  command->add_flag("--exr", flags->exr, "Write metric depth as float OpenEXR too");
  command->add_flag("--overwrite", flags->overwrite,
                    "Replace a recording made with other settings");
  command->callback([flags] { capture(*flags); });
}

}  // namespace segsim::experiments::commands
