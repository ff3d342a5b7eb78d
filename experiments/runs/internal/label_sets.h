#pragma once

/// @file
/// Data sets of views that a run's detectors are tuned on, chosen by, and judged with.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/camera.h"
#include "experiments/detection/arm_weights.h"
#include "experiments/specs/spec.h"
#include "experiments/support/stage_times.h"
#include "experiments/support/step_record.h"
#include "experiments/trials/prepared_detectors.h"

namespace segsim::experiments::runs::internal {

/// A scene with what its views must keep away from.
struct LabelScene {
  const specs::SceneSpec* spec;
  std::filesystem::path bundle;
  trials::Starts starts_m;
};

/// Of the views that detectors are tuned on.
[[nodiscard]] core::CameraIntrinsics view_camera(const specs::ExperimentSpec& spec);

/// The scenes of one reconstruction that a fine-tuning takes its views from.
/// @param bundles, starts  Of each scene of the spec.
[[nodiscard]] std::vector<LabelScene> label_scenes_of(
    const specs::ExperimentSpec& spec, int reconstruction,
    std::span<const std::filesystem::path> bundles, std::span<const trials::Starts> starts);

/// How the views of a set are drawn.
struct ViewRule {
  std::string purpose;  ///< "train", "validation" or "test".
  int per_scene = 0;
  double facing_share = 0.0;
};

/// One data set of views: of a training, or held out from all trainings of a reconstruction.
class LabelSet {
 public:
  /// @param scenes  Outlive this object.
  LabelSet(const specs::ExperimentSpec& spec, const std::vector<LabelScene>& scenes,
           const std::string& purpose, std::uint64_t seed, std::filesystem::path folder);

  [[nodiscard]] std::filesystem::path json() const;
  [[nodiscard]] bool is_current() const;
  /// Views at most, over all scenes.
  [[nodiscard]] int views() const;

  /// @param on_view  Called after each.
  void make(const std::vector<std::string>& class_names,
            const std::function<void()>& on_view) const;

 private:
  [[nodiscard]] std::string recipe() const;

  const specs::ExperimentSpec& spec_;
  const std::vector<LabelScene>& scenes_;
  ViewRule rule_;
  std::uint64_t seed_;
  std::filesystem::path folder_;
  support::StepRecord record_;
};

/// Makes those that are not there, side by side.
void make_label_sets(const std::vector<LabelSet>& sets,
                     const std::vector<std::string>& class_names, int workers,
                     support::StageTimes& times);

/// How many views of a data set lie near a start.
[[nodiscard]] records::StartLeak start_leak(const std::filesystem::path& train_json,
                                            const std::vector<LabelScene>& scenes,
                                            double clearance_m);

}  // namespace segsim::experiments::runs::internal
