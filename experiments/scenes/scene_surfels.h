#pragma once

/// @file
/// A bundle's surfels and how they are labelled, for everything that draws a bundle.

#include <memory>

#include "core/scene_bundle.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/surfels.h"

namespace segsim::experiments::scenes {

struct SceneSurfels {
  std::shared_ptr<const renderer::SurfelCloud> surfels;
  /// For make_renderer(): label distributions; nullptr: the surfels' own ids.
  std::shared_ptr<const renderer::PanopticField> labels;
};

/// @throws core::InputError for a damaged file.
[[nodiscard]] SceneSurfels load_scene_surfels(const core::SceneBundle& bundle);

/// The distributions alone; nullptr without. @param surfels  Of the bundle.
[[nodiscard]] std::shared_ptr<const renderer::PanopticField> load_scene_labels(
    const core::SceneBundle& bundle, const renderer::SurfelCloud& surfels);

}  // namespace segsim::experiments::scenes
