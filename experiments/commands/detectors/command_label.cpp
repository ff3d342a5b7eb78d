#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <numbers>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/scene_bundle.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/detection/label_report.h"
#include "experiments/detection/view_labels.h"
#include "experiments/episodes/episodes.h"
#include "perception/data/dataset.h"
#include "sim/ground/robot.h"
#include "worlds/procedural/procedural_furniture.h"

namespace segsim::experiments::commands::detectors {
namespace {

namespace fs = std::filesystem;
constexpr double kDegree_rad = std::numbers::pi / 180.0;

struct Flags {
  std::vector<fs::path> bundles, drives, avoid_episodes;
  fs::path out, class_map;
  std::vector<std::string> classes = worlds::goal_class_names();
  std::string robot = "jackal-gentle";
  int views = 200, width_px = 256, height_px = 192;
  std::uint64_t seed = 1;
  double hfov_deg = 79.0, camera_height_m = 0.0, pitch_down_deg = 0.0;
  double min_visible_px = 0.0, min_visible_fraction = 0.15, min_agreement = 0.0;
  double avoid_radius_m = 1.0;
  double val_share = 0.2, val_distance_m = 0.5, val_angle_deg = 30.0;
  std::vector<std::string> val_scenes;
};

detection::ViewLabelOptions options_for(const Flags& flags) {
  detection::ViewLabelOptions options;
  options.seed = flags.seed;
  options.views = flags.views;
  options.camera = core::CameraIntrinsics::from_fov(flags.width_px, flags.height_px,
                                                    flags.hfov_deg * kDegree_rad);
  options.camera_pitch_down_rad = flags.pitch_down_deg * kDegree_rad;
  options.class_names = flags.classes;
  if (flags.min_visible_px > 0.0) {
    options.boxes.min_visible_share =
        flags.min_visible_px / (flags.width_px * static_cast<double>(flags.height_px));
  }
  options.boxes.min_visible_fraction = flags.min_visible_fraction;
  options.min_label_agreement = flags.min_agreement;
  options.avoid_radius_m = flags.avoid_radius_m;
  for (const fs::path& file : flags.drives) options.drives.push_back(scenes::read_drive(file));
  if (!flags.class_map.empty()) {
    options.class_map = perception::read_class_map(flags.class_map);
  }
  return options;
}

/// Starts of the evaluation episodes in one scene.
std::vector<glm::dvec2> starts_in(const Flags& flags, const std::string& scene) {
  std::vector<glm::dvec2> starts_m;
  for (const fs::path& file : flags.avoid_episodes) {
    const episodes::EpisodeSet set = episodes::read_episodes(file);
    if (set.scene != scene) continue;
    for (const sim::Episode& episode : set.episodes) {
      starts_m.emplace_back(episode.start.x_m, episode.start.y_m);
    }
  }
  return starts_m;
}

std::string place_note(const Flags& flags, const std::string& scene, std::size_t starts) {
  if (starts == 0) {
    return scene + ": views may lie where evaluation episodes start (" +
           (flags.avoid_episodes.empty() ? "none were named)"
                                         : "the files that were named have none here)");
  }
  char text[100];
  std::snprintf(text, sizeof text,
                ": no view lies within %.2f m of the %zu starts of evaluation episodes",
                flags.avoid_radius_m, starts);
  return scene + text;
}

/// What the image files of each bundle begin with: the folder's name.
std::vector<std::string> image_prefixes(const std::vector<fs::path>& bundles) {
  std::map<std::string, fs::path> folder_of;
  std::vector<std::string> prefixes;
  for (const fs::path& folder : bundles) {
    fs::path whole = fs::absolute(folder).lexically_normal();
    if (whole.filename().empty()) whole = whole.parent_path();  // Ended in a slash.
    const std::string prefix = whole.filename().string() + "-";
    const auto [other, is_new] = folder_of.emplace(prefix, folder);
    if (!is_new) {
      throw core::InputError::expected(
          "bundles", "folders of different names, which become those of the images",
          other->second.string() + " and " + folder.string());
    }
    prefixes.push_back(prefix);
  }
  return prefixes;
}

void add_notes(const Flags& flags, const detection::ViewLabels& labels,
               const std::string& scene, std::size_t starts, std::vector<std::string>& notes) {
  notes.push_back(place_note(flags, scene, starts));
  const int all = static_cast<int>(labels.dataset.images.size());
  notes.push_back(scene + ": " + std::to_string(labels.drive_views) + " views along drives (" +
                  std::to_string(labels.drive_views_refused) + " refused), " +
                  std::to_string(all - labels.drive_views) + " of " +
                  std::to_string(flags.views) + " wanted at random reachable places");
  if (labels.unmapped.empty()) return;
  std::string names;
  for (const std::string& name : labels.unmapped) names += (names.empty() ? "" : ", ") + name;
  notes.push_back(scene + ": classes that the class map lacks: " + names);
}

void label(const Flags& flags) {
  if (flags.views == 0 && flags.drives.empty()) {
    throw core::InputError::expected("--views", "at least 1, or a --drive", "0");
  }
  detection::ViewLabelOptions options = options_for(flags);
  const std::vector<std::string> prefixes = image_prefixes(flags.bundles);
  detection::LabelReport report;
  for (std::size_t i = 0; i < flags.bundles.size(); ++i) {
    const core::SceneBundle bundle = core::load_bundle(flags.bundles[i]);
    const std::string& scene = bundle.manifest.name;
    options.camera_height_m =
        flags.camera_height_m > 0.0 ? flags.camera_height_m : bundle.manifest.camera_height_m;
    options.prefix = prefixes[i];
    options.avoid_m = starts_in(flags, scene);
    const detection::ViewLabels labels = detection::label_views(
        bundle, sim::RobotModel::by_name(flags.robot), options, flags.out);
    add_notes(flags, labels, scene, options.avoid_m.size(), report.notes);
    detection::append_dataset(report.dataset, labels.dataset);
    report.instances.insert(report.instances.end(), labels.instances.begin(),
                            labels.instances.end());
  }
  if (report.dataset.images.empty()) {
    throw core::InputError::expected(flags.bundles.front().string(), "views worth labelling",
                                     "none");
  }
  report.split = detection::split_views(
      report.dataset, {flags.val_share,
                       {flags.val_distance_m, flags.val_angle_deg * kDegree_rad},
                       flags.val_scenes,
                       flags.seed});
  detection::write_label_files(flags.out, report);

  std::size_t boxes = 0, ignored = 0;
  for (const perception::LabeledImage& image : report.dataset.images) {
    for (const perception::LabeledBox& box : image.boxes) (box.ignore ? ignored : boxes) += 1;
  }
  for (const std::string& note : report.notes) std::printf("%s\n", note.c_str());
  std::printf("%s: %zu views, %zu boxes, %zu too hidden or too small to count\n",
              (flags.out / "labels.json").string().c_str(), report.dataset.images.size(),
              boxes, ignored);
  std::printf("train %zu, held-out viewpoints %zu, held-out scenes %zu, dropped %d views\n",
              report.split.train.images.size(), report.split.val_views.images.size(),
              report.split.val_scenes.images.size(), report.split.dropped);
}

void add_camera_flags(CLI::App& command, Flags& flags) {
  command.add_option("--robot", flags.robot, "Decides where the camera can be")
      ->capture_default_str();
  command
      .add_option("--camera-height", flags.camera_height_m,
                  "Camera height [m]; default: the bundle's")
      ->check(light::camera_height_m());
  command.add_option("--pitch-down-deg", flags.pitch_down_deg, "Camera pitch [degrees]")
      ->check(CLI::Range(-80.0, 80.0))
      ->capture_default_str();
  command.add_option("--width", flags.width_px, "Image width [px]")
      ->check(CLI::Range(16, 8192))
      ->capture_default_str();
  command.add_option("--height", flags.height_px, "Image height [px]")
      ->check(CLI::Range(16, 8192))
      ->capture_default_str();
  command.add_option("--hfov-deg", flags.hfov_deg, "Horizontal field of view [degrees]")
      ->check(light::field_of_view_deg())
      ->capture_default_str();
}

void add_place_flags(CLI::App& command, Flags& flags) {
  command
      .add_option("--views", flags.views, "Views of each bundle at random reachable places")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  command.add_option("--seed", flags.seed, "Chooses views and split")->capture_default_str();
  command.add_option("--drive", flags.drives,
                     "YAML of way-points (docs/label_views.md): views along them come first");
  command.add_option("--avoid-episodes", flags.avoid_episodes,
                     "Episode files of an evaluation: no view near their starts");
  command.add_option("--avoid-radius-m", flags.avoid_radius_m, "How near [m]")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
}

void add_box_flags(CLI::App& command, Flags& flags) {
  command.add_option("--classes", flags.classes, "Class names to label")->delimiter(',');
  command.add_option("--class-map", flags.class_map,
                     "YAML from the scene's class names to those of --classes");
  command.add_option("--min-visible-px", flags.min_visible_px,
                     "Boxes of fewer visible pixels are ignored; default 0.06 % of the image");
  command
      .add_option("--min-visible-fraction", flags.min_visible_fraction,
                  "Boxes of objects that are hidden by more are ignored")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  command
      .add_option("--min-agreement", flags.min_agreement,
                  "Objects whose pixels agree less on their class are ignored")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
}

void add_split_flags(CLI::App& command, Flags& flags) {
  command.add_option("--val-share", flags.val_share, "Share of viewpoints to hold out")
      ->check(CLI::Range(0.0, 0.95))
      ->capture_default_str();
  command
      .add_option("--val-distance-m", flags.val_distance_m,
                  "A held-out view is this far from every training view, or ...")
      ->check(light::length_m())
      ->capture_default_str();
  command.add_option("--val-angle-deg", flags.val_angle_deg, "... turned by this [degrees]")
      ->capture_default_str();
  command.add_option("--val-scenes", flags.val_scenes, "Scenes to hold out wholly")
      ->delimiter(',');
}

}  // namespace

void add_label_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "label");
  command->add_option("bundles", flags->bundles, "Bundle folders")->required();
  command->add_option("--out", flags->out, "Folder for labels.json and images/")->required();
  add_place_flags(*command, *flags);
  add_box_flags(*command, *flags);
  add_split_flags(*command, *flags);
  add_camera_flags(*command, *flags);
  command->callback([flags] { label(*flags); });
}

}  // namespace segsim::experiments::commands::detectors
