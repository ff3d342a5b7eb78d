#pragma once

/// @file
/// What the URIs in a Gazebo world mean on this machine.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace segsim::worlds::internal {

/// Looks for models, meshes, scripts and images in these folders, in this order:
///
///   1. those that the user names, and what lies in their subfolders "*models"
///   2. GZ_SIM_RESOURCE_PATH, IGN_GAZEBO_RESOURCE_PATH, GAZEBO_MODEL_PATH,
///   GAZEBO_RESOURCE_PATH
///   3. the folder of the world and the three above it, each with its subfolders "*models"
///   4. models that `gz fuel download` or `ign fuel download` has brought to ~/.gz or
///   ~/.ignition
class ResourceFinder {
 public:
  /// @throws core::InputError if one of the folders that the user names does not exist.
  ResourceFinder(const std::filesystem::path& world_file,
                 const std::vector<std::filesystem::path>& named_folders);

  /// The file or folder that exists and that `uri` means:
  ///
  ///   model://chair/meshes/a.dae     <folder>/chair/meshes/a.dae
  ///   model://package/models/chair   the same, or <folder>/models/chair: a package has the
  ///                                  name that ROS knows, not always that of its folder
  ///   file://media/meshes/a.obj      <folder>/media/meshes/a.obj
  ///   https://fuel.../models/Chair   <folder>/Chair, or the download
  ///   meshes/a.dae                   beside the file that names it, else
  ///   <folder>/meshes/a.dae
  ///
  /// @param from_folder  Of the file that names it; empty if unknown.
  [[nodiscard]] std::optional<std::filesystem::path> find(
      const std::string& uri, const std::filesystem::path& from_folder) const;

  [[nodiscard]] const std::vector<std::filesystem::path>& folders() const { return folders_; }

 private:
  void add_with_models(const std::filesystem::path& folder);
  [[nodiscard]] std::optional<std::filesystem::path> below_folders(
      const std::filesystem::path& path) const;
  [[nodiscard]] std::optional<std::filesystem::path> find_on_fuel(
      const std::string& uri) const;

  std::vector<std::filesystem::path> folders_;
};

}  // namespace segsim::worlds::internal
