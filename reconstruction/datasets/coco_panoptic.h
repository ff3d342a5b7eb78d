#pragma once

/// @file
/// Masks in COCO's panoptic format: FILE.json (images, annotations with segments_info,
/// categories) and a folder FILE/ beside it with one PNG for each view, whose colours are ids:
/// red + 256 green + 65536 blue (cocodataset/panopticapi, read for its format).

#include <filesystem>
#include <memory>
#include <vector>

#include "core/scene_bundle.h"
#include "reconstruction/datasets/mask_files.h"

namespace segsim::reconstruction {

/// What an id of a thing means.
enum class IdScope : std::uint8_t {
  kView,  ///< A mask of its view: COCO's own files, in which no id returns.
  kScene  ///< An object of the scene: the same id is the same object in all views.
};

/// @param classes  Of a file without categories (predictions have none): ids are of these.
///     Where the file has categories, ids and names are its own.
/// @throws core::InputError naming file and key: no classes at all, an annotation of no
/// picture,
///     a category that is not listed, an id that comes twice in a view, more than 65 535
///     objects.
[[nodiscard]] std::unique_ptr<MaskSet> open_coco_panoptic(
    const std::filesystem::path& json, const std::vector<core::SceneClass>& classes,
    IdScope scope);

}  // namespace segsim::reconstruction
