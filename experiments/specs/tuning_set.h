#pragma once

/// @file
/// Which scenes the detector of an arm is fine-tuned on, scene by scene.
///
///     after            one detector for all scenes, tuned on `finetune.scenes`
///     after-here       in every scene one that was tuned on this scene alone
///     after-elsewhere  in every scene one that was tuned on others: cross-validation over
///                      the scenes of `finetune.scenes`; outside them one tuned on all
///     after-exact      as `after`, but from the recordings' own labels where a scene has
///     masks

#include <string>
#include <vector>

#include "experiments/specs/spec.h"

namespace segsim::experiments::specs {

/// Scenes that one detector is tuned on.
struct TuningSet {
  std::string name;                 ///< In names of files; empty: of `after`.
  std::vector<std::string> scenes;  ///< Families, in the order of the spec.
  bool exact_labels = false;        ///< Masks of the scenes are not looked at.

  bool operator==(const TuningSet&) const = default;
};

/// Whether `finetune` makes the detector.
[[nodiscard]] bool is_fine_tuned(ArmDetector detector);
/// Whether it is another one in every scene.
[[nodiscard]] bool is_tuned_by_scene(ArmDetector detector);

/// That of the arms with a fine-tuned detector in a scene. The spec has detectors.finetune.
[[nodiscard]] TuningSet tuning_set(const ExperimentSpec& spec, ArmDetector detector,
                                   const SceneSpec& scene);

}  // namespace segsim::experiments::specs
