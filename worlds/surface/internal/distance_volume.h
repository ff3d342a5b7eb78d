#pragma once

/// @file
/// Sparse grid of truncated signed distances: blocks of 8 x 8 x 8 voxels, found by hash.

#include <array>
#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include <glm/vec3.hpp>

#include "sim/ground/triangle_mesh.h"

namespace segsim::worlds::internal {

inline constexpr int kBlockSide = 8;
inline constexpr int kBlockVoxels = kBlockSide * kBlockSide * kBlockSide;

/// Integer places packed into one number that sorts by z, y, x; each in [-2^20, 2^20).
using PlaceKey = std::uint64_t;
inline constexpr int kPlaceBias = 1 << 20;
[[nodiscard]] constexpr PlaceKey place_key(int x, int y, int z) {
  return (static_cast<PlaceKey>(z + kPlaceBias) << 42U) |
         (static_cast<PlaceKey>(y + kPlaceBias) << 21U) |
         static_cast<PlaceKey>(x + kPlaceBias);
}
[[nodiscard]] inline glm::ivec3 place_of(PlaceKey key) {
  constexpr PlaceKey kMask = (PlaceKey{1} << 21U) - 1U;
  return glm::ivec3(static_cast<int>(key & kMask), static_cast<int>((key >> 21U) & kMask),
                    static_cast<int>((key >> 42U) & kMask)) -
         kPlaceBias;
}

struct VoxelBlock {
  glm::ivec3 place{0};                         ///< In blocks; its first voxel is 8 * place.
  std::array<float, kBlockVoxels> distance{};  ///< Positive in front of surfaces [m].
  std::array<float, kBlockVoxels> weight{};    ///< 0 = never seen.
};

/// Samples lie at the integer places times voxel_m.
struct DistanceVolume {
  double voxel_m = 0.03;
  std::vector<VoxelBlock> blocks;
  std::unordered_map<PlaceKey, std::size_t> index;

  /// nullptr if there is none.
  [[nodiscard]] const VoxelBlock* find(const glm::ivec3& place) const {
    const auto found = index.find(place_key(place.x, place.y, place.z));
    return found == index.end() ? nullptr : &blocks[found->second];
  }
};

/// Surface of distance 0 in the cells whose eight samples have all been seen, one of them with
/// `min_weight` (samples behind a surface weigh less than those in front of it). Vertices are
/// shared. Triangles face the positive side.
/// @param truncation_m  Largest distance in the volume.
[[nodiscard]] sim::TriangleMesh extract_surface(const DistanceVolume& volume,
                                                double truncation_m, double min_weight);

}  // namespace segsim::worlds::internal
