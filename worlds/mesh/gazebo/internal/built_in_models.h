#pragma once

/// @file
/// Models that every Gazebo has and that worlds therefore do not bring along.

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "core/process/temporary_folder.h"

namespace segsim::worlds::internal {

/// sun, ground_plane and the plain lights, as SDF files in a temporary folder that exists only
/// while this object does.
class BuiltInModels {
 public:
  /// The folder of the model that "model://sun" or ".../models/Sun" means; nullopt if it is
  /// none of these.
  [[nodiscard]] std::optional<std::filesystem::path> find(const std::string& uri);

 private:
  std::unique_ptr<core::TemporaryFolder> folder_;  ///< None until it is needed.
};

}  // namespace segsim::worlds::internal
