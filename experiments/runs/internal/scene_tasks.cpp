#include "experiments/runs/internal/scene_tasks.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <string>
#include <utility>

#include "core/process/kernel_choice.h"
#include "experiments/support/side_by_side.h"
#include "perception/detector/detector.h"

namespace segsim::experiments::runs::internal {

namespace fs = std::filesystem;
using support::TaskGraph;

namespace {

/// Trains with the part of libtorch's threads that one of `at_once` trainings takes. Sums are
/// split among them: reproducible work leaves them at one.
template <class Training>
void with_part_of_threads(int at_once, const Training& train) {
  std::optional<perception::ThreadCountScope> part;
  if (at_once > 1 && core::kernel_choice() == core::KernelChoice::kFast) {
    part.emplace(std::max(1, support::processor_count() / at_once));
  }
  train();
}

}  // namespace

SceneTasks::SceneTasks(const specs::ExperimentSpec& spec, fs::path work,
                       support::StageTimes& times)
    : spec_(spec), work_(std::move(work)), times_(times) {
  for (const specs::SceneSpec& scene : spec.scenes) {
    scenes_.emplace_back().spec = &scene;
    if (scene.source) {
      steps_.emplace_back(spec, scene, work_);
      if (scene.source->masks) label_steps_.emplace_back(steps_.back(), work_);
    } else {
      check_bundle(scene.bundle);
    }
  }
}

void SceneTasks::add_to(TaskGraph& graph, int workers) {
  std::map<std::string, TaskGraph::Id> captures, bundles, loaded;
  for (const SceneStep& step : steps_) {
    const std::string& family = step.scene().family;
    if (captures.contains(family) || !step.needs_capture()) continue;
    captures[family] = graph.add([this, &step] {
      support::StageTimes::Timer timer(times_, "capture/" + step.scene().family);
      timer.working();
      step.capture();
    });
  }
  const int at_once = std::max(1, std::min(workers, static_cast<int>(steps_.size())));
  for (const SceneStep& step : steps_) {
    std::vector<TaskGraph::Id> needs;
    const auto capture = captures.find(step.scene().family);
    if (capture != captures.end()) needs.push_back(capture->second);
    const auto make = [this, &step, at_once] {
      support::StageTimes::Timer timer(times_, "reconstruction/" + step.scene().name);
      if (!step.is_current()) {
        timer.working();
        with_part_of_threads(at_once, [&] { step.reconstruct(); });
      }
      check_bundle(step.scene().bundle);
    };
    bundles[step.scene().name] = graph.add(make, needs);
  }
  for (const LabelStep& step : label_steps_) {
    const std::string& name = step.scene().scene().name;
    const auto make = [this, &step, &name, at_once] {
      support::StageTimes::Timer timer(times_, "labels from masks/" + name);
      if (step.is_current()) return;
      timer.working();
      with_part_of_threads(at_once, [&] { step.make(); });
    };
    bundles[name] = graph.add(make, {bundles.at(name)});
  }
  for (SceneTask& scene : scenes_) {
    std::vector<TaskGraph::Id> needs;
    if (scene.spec->source) needs.push_back(bundles.at(scene.spec->name));
    // Further reconstructions share the episodes of the first one.
    const auto first = loaded.find(scene.spec->family);
    if (first != loaded.end()) needs.push_back(first->second);
    scene.task = graph.add([this, &scene] { load(scene); }, needs);
    loaded.emplace(scene.spec->family, scene.task);
  }
}

void SceneTasks::load(SceneTask& scene) {
  support::StageTimes::Timer timer(times_, "episodes");
  std::fprintf(stderr, "segsim: loading %s\n", scene.spec->title.c_str());
  scene.loaded.emplace(trials::load_scene(spec_, *scene.spec, scene.spec->bundle, work_));
  if (const LabelStep* step = label_step_of(*scene.spec)) {
    scene.learnt.emplace(step->load());
    // It is the same place: weights that have seen the one have seen the other.
    scene.learnt->bundle.manifest.surfels.sha256 =
        scene.loaded->bundle.manifest.surfels.sha256;
  }
  if (scene.loaded->episodes_made) timer.working();
}

const LabelStep* SceneTasks::label_step_of(const specs::SceneSpec& scene) const {
  const auto found =
      std::find_if(label_steps_.begin(), label_steps_.end(),
                   [&](const LabelStep& step) { return &step.scene().scene() == &scene; });
  return found == label_steps_.end() ? nullptr : &*found;
}

std::vector<trials::LoadedScene> SceneTasks::take() {
  std::vector<trials::LoadedScene> scenes;
  scenes.reserve(scenes_.size());
  for (SceneTask& scene : scenes_) scenes.push_back(std::move(*scene.loaded));
  return scenes;
}

}  // namespace segsim::experiments::runs::internal
