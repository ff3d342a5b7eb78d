#pragma once

/// @file
/// Whatever has surfels to look at: a bundle, a training that is not finished, a bare file.

#include <filesystem>
#include <optional>
#include <string>

#include "core/camera_path.h"
#include "core/scene_bundle.h"
#include "experiments/scenes/scene_surfels.h"

namespace segsim::experiments::scenes {

struct ViewedPlace {
  SceneSurfels scene;
  std::optional<core::SceneBundle> bundle;  ///< nullopt: no bundle.
  std::optional<core::CameraPath> cameras;  ///< Of the recording, if known.
};

/// @param place  Folder of a bundle, OUT.training of `segsim reconstruct` (surfels of the last
/// checkpoint), or surfels in the 2DGS layout (.ply).
/// @throws core::InputError: something else, a damaged file.
[[nodiscard]] ViewedPlace open_viewed_place(const std::filesystem::path& place);

/// The camera of a frame that the scene was made from.
/// @param view  From 0, in the order of cameras.txt.
/// @throws core::InputError if the place has no cameras or fewer; it names `place`.
[[nodiscard]] const core::CameraPath::View& recorded_view(const ViewedPlace& viewed,
                                                          const std::filesystem::path& place,
                                                          std::size_t view);

}  // namespace segsim::experiments::scenes
