#include "experiments/runs/prepare.h"

#include <cstdio>
#include <set>
#include <string>

#include "core/error.h"
#include "experiments/runs/internal/detector_preparation.h"
#include "experiments/runs/internal/scene_step.h"
#include "experiments/runs/internal/scene_tasks.h"
#include "experiments/support/task_graph.h"

namespace segsim::experiments::runs {
namespace {

namespace fs = std::filesystem;

/// Names of episodes are names of trials; reconstructions share them on purpose.
void check_episodes(const std::deque<internal::SceneTask>& scenes, const fs::path& work) {
  std::set<std::string> episode_ids;
  for (const internal::SceneTask& scene : scenes) {
    if (scene.spec->reconstruction > 1) continue;
    const episodes::EpisodeSet& set = scene.loaded->episodes;
    for (const sim::Episode& episode : set.episodes) {
      if (episode_ids.insert(episode.id).second) continue;
      throw core::InputError::expected("episodes of scene " + scene.spec->name,
                                       "names that no other episode of the spec has",
                                       "\"" + episode.id + "\" again");
    }
    if (scene.spec->episode_file.empty() &&
        static_cast<int>(set.episodes.size()) < scene.spec->episodes) {
      std::fprintf(stderr, "segsim: note: %s has room for %zu of %d episodes (see %s)\n",
                   scene.spec->title.c_str(), set.episodes.size(), scene.spec->episodes,
                   (work / "episodes" / (scene.spec->name + ".jsonl")).c_str());
    }
  }
}

}  // namespace

fs::path prepare_scene(const specs::ExperimentSpec& spec, const specs::SceneSpec& scene,
                       const fs::path& work) {
  if (scene.source) {
    const internal::SceneStep step(spec, scene, work);
    if (step.needs_capture()) step.capture();
    if (!step.is_current()) step.reconstruct();
  }
  internal::check_bundle(scene.bundle);
  return scene.bundle;
}

Inputs prepare_inputs(const specs::ExperimentSpec& spec, const fs::path& work, int workers,
                      support::StageTimes& times) {
  internal::SceneTasks scenes(spec, work, times);
  internal::DetectorPreparation detectors(spec, scenes.all(), work, times);
  support::TaskGraph graph;
  scenes.add_to(graph, workers);
  detectors.add_to(graph);
  graph.run(workers);
  check_episodes(scenes.all(), work);
  Inputs inputs;
  inputs.detectors = detectors.finish(workers);
  inputs.new_classes = detectors.new_classes();
  for (const internal::SceneTask& scene : scenes.all()) {
    if (!scene.learnt) continue;
    inputs.masks[scene.spec->name] = scene.learnt->words;
    inputs.learnt_bundles.push_back(scene.learnt->bundle.folder);
  }
  inputs.scenes = scenes.take();
  return inputs;
}

}  // namespace segsim::experiments::runs
