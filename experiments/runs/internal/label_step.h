#pragma once

/// @file
/// Labels for fine-tuning, learnt from masks as a segmenter makes them: the masks of a scene's
/// recording, and its bundle with labels from those.

#include <filesystem>
#include <string>

#include "core/scene_bundle.h"
#include "experiments/runs/internal/scene_step.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/support/step_record.h"

namespace segsim::experiments::runs::internal {

/// The place of a scene as one knows it who has masks of single views only.
struct LearntLabels {
  core::SceneBundle bundle;
  scenes::SceneSurfels surfels;
  std::string words;  ///< What the masks are, and how good masks and labels are.
};

/// Of a scene whose source has masks, once its bundle is there.
class LabelStep {
 public:
  /// @param scene  Outlives this object.
  /// @throws core::InputError if the masks, or the detector that makes them, are not there.
  LabelStep(const SceneStep& scene, const std::filesystem::path& work);

  [[nodiscard]] const SceneStep& scene() const { return scene_; }
  [[nodiscard]] bool is_current() const;
  void make() const;
  [[nodiscard]] LearntLabels load() const;

 private:
  [[nodiscard]] const specs::MaskSpec& spec() const { return *scene_.scene().source->masks; }
  /// All that decides the masks, in one line.
  [[nodiscard]] std::string masks_recipe() const;
  [[nodiscard]] std::filesystem::path masks_folder() const;
  void make_masks(const reconstruction::RgbdSequence& recording) const;
  [[nodiscard]] support::StepRecord record() const;

  const SceneStep& scene_;
  std::filesystem::path bundle_, masks_;
};

}  // namespace segsim::experiments::runs::internal
