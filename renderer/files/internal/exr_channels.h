#pragma once

/// @file
/// Names of channels and layers in the files of exr_io.h.

#include <array>
#include <cstdio>
#include <string>

namespace segsim::renderer::internal {

inline constexpr const char* kCryptoSemantic = "CryptoSemantic";
inline constexpr const char* kCryptoInstance = "CryptoInstance";
inline constexpr const char* kClassNames = "class_names";
inline constexpr const char* kInstanceNames = "instance_names";

/// "N" -> "N.x", "N.y", "N.z"
[[nodiscard]] inline std::array<std::string, 3> vector_channels(const std::string& image) {
  return {image + ".x", image + ".y", image + ".z"};
}

/// "semantic_feature", 7 -> "semantic_feature.07"
[[nodiscard]] inline std::string feature_channel(const std::string& image, int k) {
  char number[8];
  std::snprintf(number, sizeof number, ".%02d", k % 100);
  return image + number;
}

}  // namespace segsim::renderer::internal
