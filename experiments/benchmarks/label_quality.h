#pragma once

/// @file
/// Quality of a renderer's labels in views of which the truth is known.

#include <filesystem>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "experiments/training/mask_quality.h"
#include "reconstruction/evaluation/panoptic_report.h"

namespace segsim::experiments::benchmarks {

struct LabelledViews {
  std::string name;  ///< Of the recording.
  core::CameraIntrinsics intrinsics;
  std::vector<training::TrueLabels> views;
  std::vector<core::SceneClass> classes;   ///< Of the views' labels.
  training::ClassTranslation translation;  ///< From the scene's classes to them.
};

/// Evenly spaced frames of a recording with labels, which the scene should not have been
/// trained on.
/// @param scene_classes  Of the scene that will be drawn; they find their counterparts by
/// name.
/// @throws core::InputError for a recording that cannot be read, has no labels, or shares no
///     class with the scene.
[[nodiscard]] LabelledViews load_labelled_views(
    const std::filesystem::path& recording, int count,
    const std::vector<core::SceneClass>& scene_classes);

/// Draws the views and compares under the strict rules: segments of the whole scene.
[[nodiscard]] reconstruction::PanopticReport label_quality(core::Renderer& renderer,
                                                           const LabelledViews& truth);

}  // namespace segsim::experiments::benchmarks
