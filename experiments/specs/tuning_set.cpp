#include "experiments/specs/tuning_set.h"

#include <algorithm>

#include "core/check.h"

namespace segsim::experiments::specs {
namespace {

/// Scenes are dealt out to folds like cards, so that scenes that stand together in the spec,
/// because they are alike, come into different folds.
TuningSet without_fold(const FinetuneSpec& finetune, std::size_t place) {
  const std::size_t folds =
      finetune.folds > 0 ? static_cast<std::size_t>(finetune.folds) : finetune.scenes.size();
  const std::size_t fold = place % folds;
  TuningSet set;
  set.name = finetune.folds > 0 ? "without-fold-" + std::to_string(fold + 1)
                                : "without-" + finetune.scenes[place];
  for (std::size_t k = 0; k < finetune.scenes.size(); ++k) {
    if (k % folds != fold) set.scenes.push_back(finetune.scenes[k]);
  }
  return set;
}

}  // namespace

bool is_tuned_by_scene(ArmDetector detector) {
  return detector == ArmDetector::kAfterHere || detector == ArmDetector::kAfterElsewhere;
}

bool is_fine_tuned(ArmDetector detector) {
  return detector == ArmDetector::kAfter || detector == ArmDetector::kAfterExact ||
         is_tuned_by_scene(detector);
}

TuningSet tuning_set(const ExperimentSpec& spec, ArmDetector detector,
                     const SceneSpec& scene) {
  SEGSIM_CHECK(is_fine_tuned(detector) && spec.detectors.finetune,
               "a detector that the spec tunes");
  const FinetuneSpec& finetune = *spec.detectors.finetune;
  if (detector == ArmDetector::kAfterHere) return {"here-" + scene.family, {scene.family}};
  if (detector == ArmDetector::kAfterExact) return {"exact", finetune.scenes, true};
  const auto found = std::find(finetune.scenes.begin(), finetune.scenes.end(), scene.family);
  if (detector == ArmDetector::kAfter) return {"", finetune.scenes};
  if (found == finetune.scenes.end()) return {"pool", finetune.scenes};
  return without_fold(finetune, static_cast<std::size_t>(found - finetune.scenes.begin()));
}

}  // namespace segsim::experiments::specs
