#pragma once

/// @file
/// Models that every Gazebo has and that worlds therefore do not bring along.

#include <filesystem>
#include <optional>
#include <string>

namespace segsim::worlds::internal {

/// sun, ground_plane and the plain lights, as SDF files in a temporary folder that exists only
/// while this object does.
class BuiltInModels {
 public:
  BuiltInModels() = default;
  ~BuiltInModels();
  BuiltInModels(const BuiltInModels&) = delete;
  BuiltInModels& operator=(const BuiltInModels&) = delete;

  /// The folder of the model that "model://sun" or ".../models/Sun" means; nullopt if it is
  /// none of these.
  [[nodiscard]] std::optional<std::filesystem::path> find(const std::string& uri);

 private:
  std::filesystem::path folder_;  ///< Empty until it is needed.
};

}  // namespace segsim::worlds::internal
