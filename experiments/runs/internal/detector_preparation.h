#pragma once

/// @file
/// The detectors of a run: views of its scenes, fine-tuning on them, thresholds.

#include <cstdint>
#include <deque>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "experiments/runs/internal/fine_tuning.h"
#include "experiments/runs/internal/label_sets.h"
#include "experiments/runs/internal/scene_tasks.h"
#include "experiments/runs/internal/scene_views.h"
#include "experiments/specs/spec.h"
#include "experiments/support/stage_times.h"
#include "experiments/support/task_graph.h"
#include "experiments/trials/prepared_detectors.h"

namespace segsim::experiments::runs::internal {

/// Makes the weights that the arms of a spec need. What needs single scenes only (views) is
/// made by tasks beside them, the rest in the end.
class DetectorPreparation {
 public:
  /// @param spec, scenes, times  Outlive this object, and this the graph that runs its tasks.
  /// @throws core::InputError if weights are missing that nothing makes.
  DetectorPreparation(const specs::ExperimentSpec& spec, const std::deque<SceneTask>& scenes,
                      std::filesystem::path work, support::StageTimes& times);

  void add_to(support::TaskGraph& graph);

  /// After the graph has run: trains, once for each reconstruction and seed, and chooses
  /// thresholds. Up to `workers` / `finetune->threads` trainings run side by side; the result
  /// does not depend on how many.
  [[nodiscard]] trials::PreparedDetectors finish(int workers);

  /// After the graph has run: goals that 'before' does not know and fine-tuning teaches.
  [[nodiscard]] const std::vector<std::string>& new_classes() const { return new_classes_; }

 private:
  /// Views of one reconstruction that no training of it sees: they judge all its detectors.
  struct HeldOutViews {
    std::vector<const SceneTask*> scenes;
    std::filesystem::path validation, test;
    std::filesystem::path exact_validation{};  ///< For `after-exact`; empty without it.
  };

  [[nodiscard]] bool needs(specs::ArmDetector detector) const;
  /// Of the first reconstruction: whose goals some training learns.
  [[nodiscard]] std::vector<const SceneTask*> learnt_scenes() const;
  void pretrain();
  /// Fills in class_names_ and new_classes_.
  void choose_classes();
  /// Whether 'before' knows every class that the specs of the tuned scenes name as goals.
  [[nodiscard]] bool knows_all_goals() const;
  std::filesystem::path add_set(int reconstruction, const char* purpose, std::uint64_t seed,
                                const std::string& suffix, LabelsOf labels = LabelsOf::kMasks);
  [[nodiscard]] const HeldOutViews& held_out(int reconstruction) const;
  [[nodiscard]] trials::PreparedDetectors tuned(int workers);

  const specs::ExperimentSpec& spec_;
  const std::deque<SceneTask>& scenes_;
  std::filesystem::path work_;
  support::StageTimes& times_;
  bool wanted_ = false;  ///< Some arm runs 'before' or 'after'.
  std::vector<std::string> class_names_, new_classes_;
  ViewProgress progress_;
  std::deque<LabelSet> sets_;            ///< Empty if nothing is tuned.
  std::optional<LabelWork> label_work_;  ///< Once tasks are added.
  SceneViews scene_views_;
  std::vector<Training> trainings_;
  std::vector<std::filesystem::path> training_views_;  ///< By training; empty: scene_views_.
  std::vector<HeldOutViews> held_out_;                 ///< By reconstruction, from 1.
};

}  // namespace segsim::experiments::runs::internal
