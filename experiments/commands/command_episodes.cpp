// `segsim episodes`: generate, validate, import, export.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <numbers>

#include <CLI/CLI.hpp>

#include "core/bundle_parts.h"
#include "core/error.h"
#include "experiments/commands/commands.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/episodes/episodes.h"
#include "experiments/episodes/habitat_episodes.h"
#include "experiments/results/statistics.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/support/listed.h"
#include "experiments/trials/episode_validation.h"
#include "renderer/cpu_renderer.h"
#include "sim/trial/thing_names.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

/// The robot's eye, for sets that do not say what they were made for.
struct ViewerFlags {
  int width_px = 256, height_px = 192;
  double hfov_deg = 79.0, pitch_down_deg = 8.0;
  double camera_height_m = 0.0;  ///< 0: the bundle's.

  void add_to(CLI::App& command) {
    command.add_option("--width", width_px, "Of the robot's image [px]")
        ->check(light::image_side())
        ->capture_default_str();
    command.add_option("--height", height_px, "Of the robot's image [px]")
        ->check(light::image_side())
        ->capture_default_str();
    command.add_option("--hfov-deg", hfov_deg, "Of the robot's camera")
        ->check(CLI::Range(10.0, 150.0))
        ->capture_default_str();
    command.add_option("--pitch-down-deg", pitch_down_deg, "Of the robot's camera")
        ->check(CLI::Range(-60.0, 60.0))
        ->capture_default_str();
    command
        .add_option("--camera-height", camera_height_m,
                    "Of the robot's camera [m] (default: the bundle's)")
        ->check(light::camera_height_m());
  }
  [[nodiscard]] episodes::EpisodeViewer viewer(const core::SceneManifest& manifest) const {
    constexpr double kRadians = std::numbers::pi / 180.0;
    const double mast_m = manifest.camera_height_m > 0.0 ? manifest.camera_height_m : 1.2;
    return {core::CameraIntrinsics::from_fov(width_px, height_px, hfov_deg * kRadians),
            camera_height_m > 0.0 ? camera_height_m : mast_m, pitch_down_deg * kRadians};
  }
};

std::string counts_by_goal(const episodes::EpisodeSet& set) {
  std::map<std::string, int> counts;
  bool phrases = false;
  for (const sim::Episode& episode : set.episodes) {
    ++counts[episode.goal_name()];
    phrases = phrases || !episode.phrase.empty();
  }
  std::string text;
  for (const auto& [name, count] : counts) {
    text += (text.empty() ? "" : ", ") + name + " " + std::to_string(count);
  }
  return std::to_string(set.episodes.size()) + " episodes over " +
         std::to_string(counts.size()) + (phrases ? " goals: " : " classes: ") + text;
}

// --- generate ---

struct GenerateFlags {
  fs::path bundle, out;
  std::string robot = "jackal-gentle", name;
  episodes::EpisodeRules rules;
  ViewerFlags viewer;
  GenerateFlags() {
    // Habitat's rules (docs/episodes.md), where a spec's defaults are wider.
    rules.count = 60;
    rules.min_visible_pixels = 200;
    rules.min_start_m = 1.0;
    rules.max_start_m = 30.0;
    rules.max_view_radius_m = 1.0;
    rules.min_ratio = 1.05;
    rules.min_island_radius_m = 1.5;
  }
};

void print_rejections(const episodes::EpisodeRejections& r) {
  std::printf("view points   %d kept of %d tested; %d instances that no place sees\n",
              r.view_points_kept, r.view_points_tested, r.instances_not_visible);
  std::printf(
      "starts refused  %d see the goal, %d too near, %d too far, %d unreachable, %d too "
      "tight, "
      "%d too straight\n",
      r.starts_goal_visible, r.starts.too_near, r.starts.too_far, r.starts.unreachable,
      r.starts.too_tight, r.starts.too_straight);
}

void generate(GenerateFlags& flags) {
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  const sim::World world = sim::World::load(bundle, sim::RobotModel::by_name(flags.robot));
  const scenes::SceneSurfels scene = scenes::load_scene_surfels(bundle);
  const auto eye = renderer::make_cpu_renderer(scene.surfels, {}, scene.labels);
  episodes::EpisodeRules& rules = flags.rules;
  const std::vector<std::string> things = sim::thing_names(bundle.manifest.classes);
  if (rules.goals.empty()) rules.goals = things;
  for (const std::string& goal : rules.goals) {
    if (bundle.manifest.find_class(goal) != nullptr) continue;
    throw core::InputError::expected("--goals",
                                     "classes of the bundle (" + support::listed(things) + ")",
                                     "\"" + goal + "\"");
  }
  const episodes::EpisodeViewer viewer = flags.viewer.viewer(bundle.manifest);
  rules.camera = viewer.camera;
  rules.camera_height_m = viewer.camera_height_m;
  rules.camera_pitch_down_rad = viewer.camera_pitch_down_rad;
  const std::string name = flags.name.empty() ? bundle.manifest.name : flags.name;
  const episodes::EpisodeSet set =
      episodes::generate_episodes(name, bundle, world, *eye, rules);
  episodes::write_episodes(flags.out, set);
  std::printf("%s\n", counts_by_goal(set).c_str());
  print_rejections(set.rejections);
  if (static_cast<int>(set.episodes.size()) < rules.count) {
    std::printf("note          the scene has room for %zu of %d episodes\n",
                set.episodes.size(), rules.count);
  }
  std::printf("written to    %s (not validated: segsim episodes validate)\n",
              flags.out.c_str());
}

void add_generate(CLI::App& episodes) {
  auto flags = std::make_shared<GenerateFlags>();
  episodes::EpisodeRules& rules = flags->rules;
  CLI::App* command = episodes.add_subcommand(
      "generate", "Make search tasks for a bundle: what is seen from where, fair starts");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command->add_option("-o,--out", flags->out, "File to write (JSON Lines)")->required();
  command->add_option("--count", rules.count, "Episodes over all classes, balanced")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_option("--goals", rules.goals, "Class names (default: all things)")
      ->delimiter(',');
  command->add_option("--seed", rules.seed, "Of starts and episodes")->capture_default_str();
  command->add_option("--robot", flags->robot, "Whose room and lengths count")
      ->capture_default_str();
  command->add_option("--name", flags->name, "That begins the ids (default: the bundle's)");
  command
      ->add_option("--view-radius", rules.max_view_radius_m,
                   "View points lie at most so far from the object [m]")
      ->check(CLI::Range(0.1, 10.0))
      ->capture_default_str();
  command->add_option("--lattice", rules.view_lattice_m, "Of the places tested [m]")
      ->check(CLI::Range(0.02, 1.0))
      ->capture_default_str();
  command
      ->add_option("--min-visible-px", rules.min_visible_pixels,
                   "A view point sees at least so much of the object, and 0.2 % of the image")
      ->check(CLI::Range(1, 100000000))
      ->capture_default_str();
  command->add_option("--min-start", rules.min_start_m, "Shortest geodesic [m]")
      ->check(light::length_m())
      ->capture_default_str();
  command->add_option("--max-start", rules.max_start_m, "Longest geodesic [m]")
      ->check(light::length_m())
      ->capture_default_str();
  command
      ->add_option("--min-ratio", rules.min_ratio,
                   "Geodesic / straight below which starts are thinned out; 1 = never")
      ->check(CLI::Range(1.0, 10.0))
      ->capture_default_str();
  command->add_flag("--allow-visible-start", rules.allow_visible_start,
                    "The goal may be in view at the start");
  flags->viewer.add_to(*command);
  command->callback([flags] {
    flags->rules.view_radius_m =
        std::min(flags->rules.view_radius_m, flags->rules.max_view_radius_m);
    generate(*flags);
  });
}

// --- validate ---

struct ValidateFlags {
  fs::path file, bundle;
  trials::ValidationOptions options;
  ViewerFlags viewer;
  bool store = false;
};

void print_findings(const trials::Validation& validation) {
  std::map<std::string, int> states;
  for (const episodes::EpisodeFinding& finding : validation.findings) {
    ++states[to_string(finding.state)];
    if (finding.state == episodes::EpisodeState::kFine) continue;
    std::printf("  %-36s %s (l %.2f m in the file, %.2f m here)\n", finding.id.c_str(),
                to_string(finding.state), finding.file_m, finding.world_m);
  }
  std::string text;
  for (const auto& [state, count] : states) {
    text += (text.empty() ? "" : ", ") + state + " " + std::to_string(count);
  }
  std::printf("episodes      %zu: %s\n", validation.findings.size(), text.c_str());
  for (const records::TrialRow& trial : validation.trials) {
    if (trial.success) continue;
    char distance[32] = "off the floor";
    if (trial.distance_to_goal_m) {
      std::snprintf(distance, sizeof distance, "%.2f m", *trial.distance_to_goal_m);
    }
    std::printf("  %-36s oracle-path fails: %s %s, %s from a view point, %d px in view\n",
                trial.episode.c_str(), to_string(trial.outcome),
                core::to_string(trial.stop_reason), distance, trial.why.final_visible_px);
  }
}

void validate(const ValidateFlags& flags) {
  trials::ValidationOptions options = flags.options;
  options.viewer = flags.viewer.viewer(core::load_bundle(flags.bundle).manifest);
  const trials::Validation validation =
      trials::validate_episodes(flags.file, flags.bundle, options);
  print_findings(validation);
  const episodes::OracleRecord& oracle = validation.oracle;
  const results::Interval interval =
      results::wilson_interval({oracle.successes, oracle.episodes});
  std::printf("oracle-path   SR %d/%d = %.3f [%.3f, %.3f], SPL %.3f, profile %s\n",
              oracle.successes, oracle.episodes, oracle.rate(), interval.low, interval.high,
              oracle.spl, oracle.profile.c_str());
  if (flags.store) {
    episodes::EpisodeSet set = episodes::read_episodes(flags.file);
    set.oracle = oracle;
    episodes::write_episodes(flags.file, set);
    std::printf("stored in     %s\n", flags.file.c_str());
  }
  if (validation.flagged()) {
    char text[128];
    std::snprintf(text, sizeof text,
                  "%s: FLAGGED: oracle SR %.3f is below %.2f: do not publish rates on it",
                  flags.file.c_str(), oracle.rate(), episodes::OracleRecord::kExpected);
    throw core::CheckFailed(text);
  }
}

void add_validate(CLI::App& episodes) {
  auto flags = std::make_shared<ValidateFlags>();
  CLI::App* command = episodes.add_subcommand(
      "validate", "Check every episode and run the oracle-path arm; exit code 1 if SR < 0.95");
  command->add_option("file", flags->file, "Episodes (JSON Lines)")->required();
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command->add_option("--robot", flags->options.robot, "Default: that of the set");
  command->add_option("--profile", flags->options.profile, "Success rule by name")
      ->capture_default_str();
  command->add_option("--time-limit", flags->options.time_limit_s, "Of a trial [s]")
      ->check(CLI::Range(1.0, 100000.0))
      ->capture_default_str();
  command->add_option("--workers", flags->options.workers, "Trials at the same time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command->add_flag("--store", flags->store, "Write the oracle's SR into the file's header");
  flags->viewer.add_to(*command);
  command->callback([flags] { validate(*flags); });
}

// --- import, export ---

struct ImportFlags {
  fs::path file, out, bundle;
  std::string scene, robot = "jackal-gentle";
  std::uint64_t seed = 1;
};

void print_scene(const episodes::HabitatScene& scene, const episodes::EpisodeSet& set,
                 const episodes::HabitatImportCounts& counts) {
  std::size_t goals = 0;
  for (const auto& [category, list] : scene.goals) goals += list.size();
  std::printf("%-16s %s\n", scene.name.c_str(), counts_by_goal(set).c_str());
  std::printf(
      "%-16s %zu goal objects with %d view points, of which %d lie on no start's floor; %d "
      "sets of them are searched; episodes without a way on the start's floor: %d, "
      "unreachable: %d, blocked start: %d\n",
      "", goals, counts.view_points, counts.view_points_of_other_floors, counts.goal_sets,
      counts.other_floor, counts.unreachable, counts.blocked_start);
  if (scene.other_tasks > 0) {
    std::printf("%-16s left out: %d tasks that describe an object or show its picture\n", "",
                scene.other_tasks);
  }
}

void import(const ImportFlags& flags) {
  episodes::HabitatDataset dataset = episodes::read_habitat(flags.file);
  if (!flags.scene.empty()) {
    std::string names;
    for (const episodes::HabitatScene& scene : dataset.scenes) {
      names += (names.empty() ? "" : ", ") + scene.name;
    }
    std::erase_if(dataset.scenes, [&](const episodes::HabitatScene& scene) {
      return scene.name != flags.scene;
    });
    if (dataset.scenes.empty()) {
      throw core::InputError::expected("--scene", "one of " + names,
                                       "\"" + flags.scene + "\"");
    }
  }
  if (!flags.bundle.empty() && dataset.scenes.size() > 1) {
    throw core::InputError::expected("--bundle", "one scene (name it with --scene)",
                                     std::to_string(dataset.scenes.size()));
  }
  std::optional<core::SceneBundle> bundle;
  std::optional<sim::World> world;
  core::BundleParts parts;
  std::optional<episodes::HabitatBinding> binding;
  if (!flags.bundle.empty()) {
    bundle = core::load_bundle(flags.bundle);
    parts = core::load_bundle_parts(flags.bundle);
    world = sim::World::load(*bundle, sim::RobotModel::by_name(flags.robot));
    binding = episodes::HabitatBinding{&*bundle, &parts.levelling, &*world};
  }
  std::string unbound;
  std::size_t episodes = 0;
  for (const episodes::HabitatScene& scene : dataset.scenes) {
    episodes::HabitatImportCounts counts;
    const episodes::EpisodeSet set =
        episodes::episodes_from_habitat(scene, dataset.split, binding, flags.seed, &counts);
    print_scene(scene, set, counts);
    unbound += (unbound.empty() ? "" : ", ") + scene.scene_id;
    episodes += set.episodes.size();
    if (!flags.out.empty()) episodes::write_episodes(flags.out / (scene.name + ".jsonl"), set);
  }
  if (!binding) {
    std::printf(
        "NOT RUNNABLE: these %zu episodes need scenes that are licensed and not in the files "
        "(%s); with a bundle of a scene, import again with --bundle.\n",
        episodes, unbound.c_str());
  }
  if (!flags.out.empty()) std::printf("written to %s\n", flags.out.c_str());
}

void add_import(CLI::App& episodes) {
  auto flags = std::make_shared<ImportFlags>();
  CLI::App* command = episodes.add_subcommand(
      "import",
      "Read Habitat ObjectNav episodes (json.gz); without -o only tell what is there");
  command->add_option("file", flags->file, "<split>.json.gz, or one file of content/")
      ->required();
  command->add_option("-o,--out", flags->out, "Folder for <scene>.jsonl");
  command->add_option("--bundle", flags->bundle,
                      "Reconstruction of the scene: lengths, floors and classes are checked");
  command->add_option("--scene", flags->scene, "Only this scene");
  command->add_option("--robot", flags->robot, "Whose lengths count (with --bundle)")
      ->capture_default_str();
  command->add_option("--seed", flags->seed, "Of the episodes")->capture_default_str();
  command->callback([flags] { import(*flags); });
}

struct ExportFlags {
  fs::path file, bundle, out;
  std::string split = "val", scene_id;
};

void export_set(const ExportFlags& flags) {
  const episodes::EpisodeSet set = episodes::read_episodes(flags.file);
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  const core::BundleParts parts = core::load_bundle_parts(flags.bundle);
  if (!set.scene_sha256.empty() && set.scene_sha256 != bundle.scene_sha256) {
    throw core::InputError::expected(flags.file.string(),
                                     "episodes of the bundle " + flags.bundle.string(),
                                     "those of another");
  }
  const std::string scene_id =
      flags.scene_id.empty() ? bundle.manifest.name + ".glb" : flags.scene_id;
  const fs::path content =
      episodes::write_habitat(flags.out, flags.split, scene_id, set, bundle, parts.levelling);
  std::printf("%s\nwritten to    %s, %s\n", counts_by_goal(set).c_str(),
              (flags.out / (flags.split + ".json.gz")).c_str(), content.c_str());
}

void add_export(CLI::App& episodes) {
  auto flags = std::make_shared<ExportFlags>();
  CLI::App* command =
      episodes.add_subcommand("export", "Write episodes as Habitat ObjectNav files (json.gz)");
  command->add_option("file", flags->file, "Episodes (JSON Lines)")->required();
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command->add_option("-o,--out", flags->out, "Folder to write")->required();
  command->add_option("--split", flags->split, "Name of the split")->capture_default_str();
  command->add_option("--scene-id", flags->scene_id,
                      "The scene's mesh as Habitat finds it (default: <bundle's name>.glb)");
  command->callback([flags] { export_set(*flags); });
}

}  // namespace

void add_episodes_command(CLI::App& app) {
  CLI::App* episodes = light::add_listed(app, light::kCommands, "episodes");
  episodes->require_subcommand(1);
  add_generate(*episodes);
  add_validate(*episodes);
  add_import(*episodes);
  add_export(*episodes);
}

}  // namespace segsim::experiments::commands
