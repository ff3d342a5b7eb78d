#include "experiments/runs/internal/scene_views.h"

#include <algorithm>
#include <utility>

#include "experiments/detection/view_labels.h"
#include "perception/data/dataset.h"

namespace segsim::experiments::runs::internal {

namespace fs = std::filesystem;

SceneViews::SceneViews(const specs::ExperimentSpec& spec, const std::deque<SceneTask>& scenes,
                       fs::path work)
    : spec_(spec), scenes_(scenes), work_(std::move(work)) {}

std::vector<const SceneTask*> SceneViews::shown_by(const Training& training) const {
  std::vector<const SceneTask*> shown;
  for (const SceneTask& scene : scenes_) {
    const std::vector<std::string>& set = training.set.scenes;
    const bool in_set = std::find(set.begin(), set.end(), scene.spec->family) != set.end();
    if (in_set && scene.spec->reconstruction == training.reconstruction)
      shown.push_back(&scene);
  }
  return shown;
}

std::vector<const SceneTask*> SceneViews::run_in(const Training& training) const {
  std::vector<const SceneTask*> run;
  for (const SceneTask& scene : scenes_) {
    if (scene.spec->reconstruction != training.reconstruction) continue;
    const auto decides = [&](const specs::ArmSpec& arm) {
      return arm.finetune_seed && arm.reconstruction == training.reconstruction &&
             training_in(spec_, arm, *scene.spec).suffix == training.suffix;
    };
    if (std::any_of(spec_.arms.begin(), spec_.arms.end(), decides)) run.push_back(&scene);
  }
  return run;
}

fs::path SceneViews::folder(const Training& training, std::uint64_t seed) const {
  return work_ / ("views" + specs::repetition_suffix(spec_, training.reconstruction, seed));
}

void SceneViews::want(const Training& training, const SceneTask& scene, const char* purpose,
                      std::uint64_t seed, std::deque<LabelSet>& sets) {
  const fs::path of_scene = folder(training, seed) / "scenes" / scene.spec->family;
  const fs::path json = of_scene / (std::string(purpose) + ".json");
  if (!wanted_.emplace(json, &scene).second) return;
  sets.emplace_back(spec_, std::vector<const SceneTask*>{&scene}, purpose, seed, of_scene);
}

void SceneViews::want(const Training& training, std::deque<LabelSet>& sets) {
  // Held-out views are the same for all trainings, as those of `after` are.
  const std::uint64_t held_out = spec_.detectors.finetune->seed;
  for (const SceneTask* scene : shown_by(training)) {
    want(training, *scene, "train", training.seed, sets);
    want(training, *scene, "validation", held_out, sets);
  }
  for (const SceneTask* scene : run_in(training)) {
    want(training, *scene, "test", held_out, sets);
  }
}

fs::path SceneViews::together(const Training& training,
                              const std::vector<const SceneTask*>& scenes,
                              const std::string& purpose, std::uint64_t seed) const {
  const fs::path all = folder(training, seed);
  const auto part = [&](const SceneTask* scene) {
    return all / "scenes" / scene->spec->family / (purpose + ".json");
  };
  if (scenes.size() == 1) return part(scenes.front());
  const fs::path own = all / training.set.name;
  perception::CocoDataset set;
  for (const SceneTask* scene : scenes) {
    perception::CocoDataset views = perception::read_coco(part(scene));
    for (perception::LabeledImage& image : views.images) {
      image.file =
          (fs::path("..") / "scenes" / scene->spec->family / image.file).generic_string();
    }
    detection::append_dataset(set, views);
  }
  fs::path json = own / (purpose + ".json");
  perception::write_coco(json, set);
  return json;
}

TrainingViews SceneViews::of(const Training& training) const {
  const std::uint64_t held_out = spec_.detectors.finetune->seed;
  const std::vector<const SceneTask*> shown = shown_by(training), run = run_in(training);
  return {run, together(training, shown, "train", training.seed),
          together(training, shown, "validation", held_out),
          together(training, run, "test", held_out)};
}

}  // namespace segsim::experiments::runs::internal
