// From a spec's scene to what trials need in memory.
#include <cstdio>
#include <functional>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/episodes/episode_check.h"
#include "experiments/runs/trial_runner.h"
#include "experiments/scenes/scene_surfels.h"
#include "renderer/cpu_renderer.h"
#include "sim/robot.h"

namespace segsim::experiments {

namespace fs = std::filesystem;

EpisodeRules episode_rules(const ExperimentSpec& spec, const SceneSpec& scene) {
  EpisodeRules rules;
  rules.goals = scene.goals;
  rules.count = scene.episodes;
  rules.seed = spec.seed;
  rules.camera = spec.camera.intrinsics();
  rules.camera_height_m = scene.camera_height_m;
  rules.camera_pitch_down_rad = spec.camera.pitch_down_rad();
  rules.min_visible_pixels = spec.success.visible_pixels;
  rules.visible_start_pixels = spec.success.visible_pixels;
  rules.min_start_m = scene.min_start_distance_m;
  rules.max_start_m = scene.max_start_distance_m;
  rules.allow_visible_start = scene.allow_visible_start;
  return rules;
}

namespace {

/// Those of the file if it was made by the same rules for the same bundle; else new ones.
EpisodeSet generated_episodes(
    const fs::path& file, const std::string& scene_name, const core::SceneBundle& bundle,
    const sim::World& world, const EpisodeRules& rules,
    const std::function<std::unique_ptr<core::Renderer>()>& make_eye) {
  if (fs::exists(file)) {
    EpisodeSet kept = read_episodes(file);
    if (kept.scene == scene_name && kept.scene_sha256 == bundle.scene_sha256 &&
        kept.rules_sha256 == rules_hash(rules, world.robot().name)) {
      return kept;
    }
  }
  const auto eye = make_eye();
  write_episodes(file, generate_episodes(scene_name, bundle, world, *eye, rules));
  return read_episodes(file);
}

/// A given set, made ready for this world; what cannot be done is said once.
EpisodeSet bound_episodes(const fs::path& file, const core::SceneBundle& bundle,
                          const sim::World& world) {
  EpisodeSet set = read_episodes(file);
  const std::vector<EpisodeFinding> findings =
      bind_episodes(set, file.string(), bundle, world);
  int infeasible = 0, changed = 0;
  for (const EpisodeFinding& finding : findings) {
    infeasible += finding.infeasible() ? 1 : 0;
    changed += finding.state == EpisodeState::kWrongLength ? 1 : 0;
  }
  if (infeasible + changed > 0) {
    std::fprintf(stderr,
                 "segsim: note: %s: of %zu episodes %d cannot be done by %s (in no rate), %d "
                 "have another shortest path than the file says\n",
                 file.c_str(), set.episodes.size(), infeasible, world.robot().name.c_str(),
                 changed);
  }
  return set;
}

}  // namespace

LoadedScene load_scene(const ExperimentSpec& spec, const SceneSpec& scene,
                       const fs::path& bundle_folder, const fs::path& work) {
  const sim::RobotModel robot = sim::RobotModel::by_name(spec.robot);
  core::SceneBundle bundle = core::load_bundle(bundle_folder);
  sim::World world = sim::World::load(bundle, robot);
  auto [surfels, labels] = load_scene_surfels(bundle);
  if (!surfels->has_labels()) {
    throw core::InputError::expected(bundle.surfels_file().string(), "labelled surfels",
                                     "none");
  }

  const fs::path file = scene.episode_file.empty()
                            ? work / "episodes" / (scene.name + ".jsonl")
                            : scene.episode_file;
  EpisodeSet episodes =
      scene.episode_file.empty()
          ? generated_episodes(
                file, scene.name, bundle, world, episode_rules(spec, scene),
                [&] { return renderer::make_cpu_renderer(surfels, {}, labels); })
          : bound_episodes(file, bundle, world);
  FloorPlan plan = make_floor_plan(*surfels);
  std::shared_ptr<const sim::SensorSettings> sensors;
  if (spec.sensors) sensors = bind_sensors(*spec.sensors, bundle, world);
  return {&scene,
          std::move(bundle),
          std::move(world),
          std::move(surfels),
          std::move(labels),
          std::move(plan),
          std::move(episodes),
          core::sha256_of_file(file),
          std::move(sensors)};
}

}  // namespace segsim::experiments
