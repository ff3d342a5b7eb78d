#pragma once

/// @file
/// A bundle's surfels and how they are labelled, for everything that draws a bundle.

#include <filesystem>
#include <memory>

#include "core/scene_bundle.h"
#include "renderer/files/label_edits.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer {

struct SceneSurfels {
  std::shared_ptr<const SurfelCloud> surfels;
  /// For make_renderer(): label distributions; nullptr: the surfels' own ids.
  std::shared_ptr<const PanopticField> labels;
};

/// With the labels that were set by hand, if there are (docs/scene_label.md).
/// @throws core::InputError for a damaged file.
[[nodiscard]] SceneSurfels load_scene_surfels(const core::SceneBundle& bundle);

/// As they were made, without those labels.
/// @throws core::InputError for a damaged file.
[[nodiscard]] SceneSurfels load_unedited_surfels(const core::SceneBundle& bundle);

/// The scene with other labels; what `edits` does not touch is shared or copied as it is.
[[nodiscard]] SceneSurfels edited_surfels(const SceneSurfels& unedited,
                                          const LabelEdits& edits);

}  // namespace segsim::renderer
