#pragma once

/// @file
/// What Python calls a scene: surfels with their labels, and the names of these.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nanobind/nanobind.h>

#include "core/camera_path.h"
#include "core/scene_bundle.h"
#include "renderer/files/scene_surfels.h"

namespace segsim::python {

struct CountedClass {
  core::SceneClass scene_class;
  std::uint64_t surfels = 0;  ///< By the surfels' own ids.
};

struct CountedInstance {
  core::SceneInstance instance;
  std::uint64_t surfels = 0;
};

struct Scene {
  std::string name;
  std::filesystem::path path;
  renderer::SceneSurfels content;
  std::vector<CountedClass> classes;  ///< Empty for a bare file of surfels.
  std::vector<CountedInstance> instances;
  std::optional<core::CameraPath> recording;  ///< The cameras that it was made from.
};

/// @param path  Folder of a bundle, or surfels in the 2DGS layout (.ply).
/// @throws core::InputError for something else, or a damaged file.
[[nodiscard]] Scene load_scene(const std::filesystem::path& path);

/// Scene, SceneClass, SceneInstance and Recording.
void bind_scene(nanobind::module_& module);

}  // namespace segsim::python
