#pragma once

/// @file
/// Views of single scenes, each drawn once, and data sets that are put together from them: for
/// detectors that are tuned on some scenes of a run and not on others.

#include <cstdint>
#include <deque>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "experiments/runs/internal/fine_tuning.h"
#include "experiments/runs/internal/label_sets.h"
#include "experiments/runs/internal/scene_tasks.h"
#include "experiments/specs/spec.h"

namespace segsim::experiments::runs::internal {

/// Data sets of one training that is tuned scene by scene.
struct TrainingViews {
  std::vector<const SceneTask*> run_in;  ///< Scenes whose trials it decides.
  /// Views of the scenes of its set; `test` shows those that it runs in.
  std::filesystem::path train, validation, test;
};

class SceneViews {
 public:
  /// @param spec, scenes  Outlive this object.
  SceneViews(const specs::ExperimentSpec& spec, const std::deque<SceneTask>& scenes,
             std::filesystem::path work);

  /// Adds the sets of single scenes that a training needs, and are not among them, to `sets`.
  void want(const Training& training, std::deque<LabelSet>& sets);

  /// When those sets are made: the training's own ones, put together from them.
  [[nodiscard]] TrainingViews of(const Training& training) const;

 private:
  [[nodiscard]] std::vector<const SceneTask*> shown_by(const Training& training) const;
  [[nodiscard]] std::vector<const SceneTask*> run_in(const Training& training) const;
  [[nodiscard]] std::filesystem::path folder(const Training& training,
                                             std::uint64_t seed) const;
  void want(const Training& training, const SceneTask& scene, const char* purpose,
            std::uint64_t seed, std::deque<LabelSet>& sets);
  [[nodiscard]] std::filesystem::path together(const Training& training,
                                               const std::vector<const SceneTask*>& scenes,
                                               const std::string& purpose,
                                               std::uint64_t seed) const;

  const specs::ExperimentSpec& spec_;
  const std::deque<SceneTask>& scenes_;
  std::filesystem::path work_;
  std::map<std::filesystem::path, const SceneTask*> wanted_;  ///< By file.
};

}  // namespace segsim::experiments::runs::internal
