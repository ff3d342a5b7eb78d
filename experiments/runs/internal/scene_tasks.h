#pragma once

/// @file
/// The scenes of a run as tasks: captured, reconstructed, loaded with their episodes.

#include <deque>
#include <filesystem>
#include <optional>
#include <vector>

#include "experiments/runs/internal/label_step.h"
#include "experiments/runs/internal/scene_step.h"
#include "experiments/specs/spec.h"
#include "experiments/support/stage_times.h"
#include "experiments/support/task_graph.h"
#include "experiments/trials/trial_runner.h"

namespace segsim::experiments::runs::internal {

/// A scene of the spec, and the task that loads it.
struct SceneTask {
  const specs::SceneSpec* spec = nullptr;
  std::optional<trials::LoadedScene> loaded{};  ///< Once the task has ended.
  /// What a detector learns the scene from, once the task has ended; nullopt: from `loaded`,
  /// whose labels are the recording's.
  std::optional<LearntLabels> learnt{};
  support::TaskGraph::Id task = 0;
};

class SceneTasks {
 public:
  /// @param spec, times  Outlive this object, and this the graph that runs its tasks.
  /// @throws core::InputError if a scene has neither a source nor a bundle to drive in.
  SceneTasks(const specs::ExperimentSpec& spec, std::filesystem::path work,
             support::StageTimes& times);

  /// @param workers  Of the graph.
  void add_to(support::TaskGraph& graph, int workers);

  /// As many as spec.scenes, in that order.
  [[nodiscard]] const std::deque<SceneTask>& all() const { return scenes_; }
  /// After the graph has run.
  [[nodiscard]] std::vector<trials::LoadedScene> take();

 private:
  void load(SceneTask& scene);
  /// The step that learns labels for a scene; nullptr: none does.
  [[nodiscard]] const LabelStep* label_step_of(const specs::SceneSpec& scene) const;

  const specs::ExperimentSpec& spec_;
  std::filesystem::path work_;
  support::StageTimes& times_;
  std::deque<SceneStep> steps_;        ///< Of scenes with a source.
  std::deque<LabelStep> label_steps_;  ///< Of scenes whose source has masks.
  std::deque<SceneTask> scenes_;
};

}  // namespace segsim::experiments::runs::internal
