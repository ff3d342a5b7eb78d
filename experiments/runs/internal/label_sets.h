#pragma once

/// @file
/// Data sets of views that a run's detectors are tuned on, chosen by, and judged with.

#include <cstdint>
#include <deque>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/progress.h"
#include "experiments/records/held_out_precision.h"
#include "experiments/runs/internal/scene_tasks.h"
#include "experiments/specs/spec.h"
#include "experiments/support/stage_times.h"
#include "experiments/support/step_record.h"
#include "experiments/support/task_graph.h"
#include "perception/data/dataset.h"

namespace segsim::experiments::runs::internal {

/// Of the views that detectors are tuned on.
[[nodiscard]] core::CameraIntrinsics view_camera(const specs::ExperimentSpec& spec);

/// The scenes of one reconstruction that a fine-tuning takes its views from.
[[nodiscard]] std::vector<const SceneTask*> label_scenes_of(
    const specs::ExperimentSpec& spec, int reconstruction,
    const std::deque<SceneTask>& scenes);

/// How the views of a set are drawn.
struct ViewRule {
  std::string purpose;  ///< "train", "validation" or "test".
  int per_scene = 0;
  double facing_share = 0.0;
};

/// The progress line of all views; begins with the first. By any thread.
class ViewProgress {
 public:
  void expect(int views) { total_ += views; }
  void drawn();
  void were_there(int views);

 private:
  std::mutex mutex_;
  std::int64_t total_ = 0, done_ = 0;
  std::optional<core::Progress> line_;
};

/// What the tasks of all sets share.
struct LabelWork {
  const std::vector<std::string>& class_names;  ///< Known when `classes_known` has ended.
  const std::vector<std::string>& new_classes;  ///< Those of them that the detector learns.
  support::TaskGraph::Id classes_known;
  ViewProgress& progress;
  support::StageTimes& times;
};

/// Which labels the views of scenes with masks have.
enum class LabelsOf : std::uint8_t {
  kMasks,  ///< What was learnt from the masks.
  kTruth,  ///< The recording's.
};

/// One data set of views: of a training, or held out from all trainings of a reconstruction.
class LabelSet {
 public:
  /// @param spec  Outlives this object.
  /// @param labels  Of the views that are learnt from; tests show the truth in any case.
  LabelSet(const specs::ExperimentSpec& spec, std::vector<const SceneTask*> scenes,
           const std::string& purpose, std::uint64_t seed, std::filesystem::path folder,
           LabelsOf labels = LabelsOf::kMasks);

  [[nodiscard]] std::filesystem::path json() const;

  /// Makes the set if it is not there: a task for each scene, which begins when the scene is
  /// loaded, and one that puts their views together.
  /// @param work  Outlives the run of the graph, as this object does.
  void add_to(support::TaskGraph& graph, const LabelWork& work);

 private:
  void draw(std::size_t scene, const LabelWork& work);
  /// What labels the scene in this set; nullptr: its own bundle.
  [[nodiscard]] const LearntLabels* learnt_of(const SceneTask& scene) const;
  void write(const LabelWork& work) const;
  /// Needs all scenes.
  [[nodiscard]] support::StepRecord record(const LabelWork& work) const;

  const specs::ExperimentSpec& spec_;
  std::vector<const SceneTask*> scenes_;
  ViewRule rule_;
  std::uint64_t seed_;
  std::filesystem::path folder_;
  LabelsOf labels_;
  bool is_current_ = false;
  std::vector<perception::CocoDataset> drawn_;  ///< By scene.
};

/// How many views of a data set lie near a start.
[[nodiscard]] records::StartLeak start_leak(const perception::CocoDataset& train,
                                            const std::vector<const SceneTask*>& scenes,
                                            double clearance_m);

}  // namespace segsim::experiments::runs::internal
