// From a spec's scene to what trials need in memory.
#include <cstdio>
#include <functional>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/episodes/episode_check.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/trials/internal/scene_phrases.h"
#include "experiments/trials/trial_runner.h"
#include "renderer/cpu_renderer.h"
#include "sim/ground/robot.h"

namespace segsim::experiments::trials {

namespace fs = std::filesystem;

episodes::EpisodeRules episode_rules(const specs::ExperimentSpec& spec,
                                     const specs::SceneSpec& scene) {
  episodes::EpisodeRules rules;
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

/// Where a scene has its episodes from.
struct SceneEpisodes {
  episodes::EpisodeSet set;
  fs::path file;
  bool made = false;  ///< Now.
};

/// Those of the file if it was made by the same rules for the same bundle; else new ones.
SceneEpisodes generated_episodes(
    const fs::path& file, const std::string& scene_name, const core::SceneBundle& bundle,
    const sim::World& world, const episodes::EpisodeRules& rules,
    const std::function<std::unique_ptr<core::Renderer>()>& make_eye) {
  if (fs::exists(file)) {
    episodes::EpisodeSet kept = episodes::read_episodes(file);
    if (kept.scene == scene_name && kept.scene_sha256 == bundle.scene_sha256 &&
        kept.rules_sha256 == episodes::rules_hash(rules, world.robot().name)) {
      return {std::move(kept), file};
    }
  }
  const auto eye = make_eye();
  episodes::write_episodes(
      file, episodes::generate_episodes(scene_name, bundle, world, *eye, rules));
  return {episodes::read_episodes(file), file, true};
}

/// A given set, made ready for this world; what cannot be done is said once.
episodes::EpisodeSet bound_episodes(episodes::EpisodeSet set, const fs::path& file,
                                    const core::SceneBundle& bundle, const sim::World& world) {
  const std::vector<episodes::EpisodeFinding> findings =
      episodes::bind_episodes(set, file.string(), bundle, world);
  int infeasible = 0, changed = 0;
  for (const episodes::EpisodeFinding& finding : findings) {
    infeasible += finding.infeasible() ? 1 : 0;
    changed += finding.state == episodes::EpisodeState::kWrongLength ? 1 : 0;
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

/// Those of the first reconstruction in another one.
SceneEpisodes shared_episodes(const fs::path& first, const fs::path& file,
                              const core::SceneBundle& bundle, const sim::World& world) {
  episodes::EpisodeSet set = episodes::read_episodes(first);
  set.scene_sha256 = bundle.scene_sha256;
  set.oracle.reset();
  for (sim::Episode& episode : set.episodes) {  // Ids of instances are the first one's.
    if (!episode.phrase.empty()) {
      throw core::InputError::expected(
          first.string() + ": " + episode.id,
          "goals that are classes, because things of another reconstruction have other ids",
          "the phrase \"" + episode.phrase + "\"");
    }
    episode.view_point_instance.clear();
    episode.view_point_iou.clear();
  }
  episodes::write_episodes(file, bound_episodes(std::move(set), file, bundle, world));
  return {episodes::read_episodes(file), file};
}

SceneEpisodes episodes_of(const specs::ExperimentSpec& spec, const specs::SceneSpec& scene,
                          const core::SceneBundle& bundle, const sim::World& world,
                          const fs::path& work,
                          const std::function<std::unique_ptr<core::Renderer>()>& make_eye) {
  const fs::path own = work / "episodes" / (scene.name + ".jsonl");
  const bool given = !scene.episode_file.empty();
  if (scene.reconstruction > 1) {
    const fs::path first =
        given ? scene.episode_file : work / "episodes" / (scene.family + ".jsonl");
    return shared_episodes(first, own, bundle, world);
  }
  if (given) {
    const fs::path& file = scene.episode_file;
    return {bound_episodes(episodes::read_episodes(file), file, bundle, world), file};
  }
  episodes::EpisodeRules rules = episode_rules(spec, scene);
  rules.phrases = scene_phrases(spec, scene, bundle, work, make_eye);
  return generated_episodes(own, scene.name, bundle, world, rules, make_eye);
}

}  // namespace

LoadedScene load_scene(const specs::ExperimentSpec& spec, const specs::SceneSpec& scene,
                       const fs::path& bundle_folder, const fs::path& work) {
  core::SceneBundle bundle = core::load_bundle(bundle_folder);
  sim::World world = sim::World::load(bundle, spec.robot);
  renderer::SceneSurfels own = scenes::load_scene_surfels(bundle);
  if (!own.surfels->has_labels()) {
    throw core::InputError::expected(bundle.surfels_file().string(), "labelled surfels",
                                     "none");
  }

  SceneEpisodes episodes = episodes_of(spec, scene, bundle, world, work, [&] {
    return renderer::make_cpu_renderer(own.surfels, {}, own.labels);
  });
  drawing::FloorPlan plan = drawing::make_floor_plan(*own.surfels);
  std::shared_ptr<const sim::SensorSettings> sensors;
  if (spec.sensors) sensors = specs::bind_sensors(*spec.sensors, bundle, world);
  return {&scene,
          std::move(bundle),
          std::move(world),
          std::move(own.surfels),
          std::move(own.labels),
          std::move(plan),
          std::move(episodes.set),
          core::sha256_of_file(episodes.file),
          episodes.made,
          std::move(sensors)};
}

}  // namespace segsim::experiments::trials
