#pragma once

/// @file
/// From a trained field to ids on surfels, which is what everything that does not draw the
/// field itself reads.

#include <vector>

#include "core/scene_bundle.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction {

/// Gives every surfel the labels that a pixel of it alone would show.
void label_surfels(const renderer::PanopticField& field, renderer::SurfelCloud& surfels);

/// The instances that surfels carry, ascending by id, with boxes and the class that most of
/// their surfels have; "<class> <id>" is the name. Instances of stuff or void are left out.
[[nodiscard]] std::vector<core::SceneInstance> instances_of(
    const renderer::SurfelCloud& surfels, const std::vector<core::SceneClass>& classes);

}  // namespace segsim::reconstruction
