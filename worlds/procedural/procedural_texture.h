#pragma once

/// @file
/// Pictures of materials, computed from a seed. All but kPicture, kScreen, kView and kRug
/// repeat without a seam.

#include <array>
#include <cstdint>

#include <glm/vec3.hpp>

#include "core/image.h"

namespace segsim::worlds {

enum class TextureKind : std::uint8_t {
  kWood,     ///< Grain along u.
  kPlanks,   ///< Floor boards along u.
  kParquet,  ///< Basket-weave blocks.
  kTiles,    ///< Square tiles (colour a, every second one b) with joints (c).
  kPlaster,
  kWallpaper,  ///< Vertical stripes with a small motif.
  kWeave,      ///< Plain woven cloth.
  kStripes,
  kChecks,  ///< Tartan.
  kFloral,  ///< Blossoms (b, c) on cloth (a).
  kMarble,
  kLeather,
  kCarpet,
  kMetal,    ///< Brushed along u.
  kPicture,  ///< Abstract painting or landscape.
  kScreen,   ///< A television's picture, dark and bluish.
  kView,     ///< What is seen through a window.
  kRug,      ///< Border and medallions.
  kLeaf,
};

struct TextureRecipe {
  TextureKind kind = TextureKind::kPlaster;
  std::array<glm::vec3, 3> palette{glm::vec3(0.8F), glm::vec3(0.6F),
                                   glm::vec3(0.4F)};  ///< sRGB.
  int size_px = 256;                                  ///< Width and height, > 0.
  std::uint64_t seed = 0;
};

/// sRGB picture; equal recipes give equal pictures.
[[nodiscard]] core::Image<core::Rgb8> make_texture(const TextureRecipe& recipe);

}  // namespace segsim::worlds
