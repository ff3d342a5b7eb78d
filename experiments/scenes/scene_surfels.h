#pragma once

/// @file
/// A bundle's surfels with their labels: read in renderer/files/scene_surfels.h, written here.

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "renderer/files/scene_surfels.h"
#include "renderer/scene/panoptic_field.h"

namespace segsim::experiments::scenes {

using renderer::edited_surfels;
using renderer::load_scene_surfels;
using renderer::load_unedited_surfels;
using renderer::SceneSurfels;

/// Writes what labels the surfels of a bundle beside their own ids: the trained model, if
/// there is one, and the label distributions, if there are.
/// @return  Name of the file with the distributions, for core::BundleParts; empty without.
[[nodiscard]] std::string write_label_files(
    const std::filesystem::path& folder, const std::optional<renderer::PanopticModel>& model,
    const std::shared_ptr<const renderer::PanopticField>& field);

}  // namespace segsim::experiments::scenes
