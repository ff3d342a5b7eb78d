#pragma once

/// @file
/// A picture of how far a training has come.

#include <filesystem>
#include <memory>

#include "reconstruction/training/training_set.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/surfels.h"

namespace segsim::experiments::training {

/// Rendered | recorded | panoptic, of a view in the middle: a held-out one if there is any.
/// @param field  May be null.
void write_preview(const std::filesystem::path& file, const reconstruction::TrainingSet& set,
                   std::shared_ptr<const renderer::SurfelCloud> surfels,
                   std::shared_ptr<const renderer::PanopticField> field, int threads);

}  // namespace segsim::experiments::training
