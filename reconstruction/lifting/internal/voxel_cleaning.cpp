#include "reconstruction/lifting/internal/voxel_cleaning.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include <Eigen/Dense>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>

#include "renderer/scene/parallel.h"

namespace segsim::reconstruction::internal {
namespace {

// A surface is clearly behind a point if it is further by this much.
constexpr float kThrough_m = 0.04F, kThroughRatio = 0.025F;
constexpr int kFewestThrough = 2;

/// Which cells are taken, and by which voxel. Cells lie in blocks of 4 x 4 x 4, whose voxels
/// follow one another in a list that is sorted by key: a bit a cell and the index of the first
/// voxel say all, and a neighbourhood needs eight look-ups at most.
class KeyIndex {
 public:
  /// @param voxels  In ascending order of key.
  explicit KeyIndex(std::span<const Voxel> voxels);

  /// Calls visit(index) for the voxels of the cube of 2 `reach` + 1 cells around `cell`, along
  /// x first, then y, then z. @param reach  1 or 2.
  template <class Visit>
  void for_each_near(const glm::ivec3& cell, int reach, Visit&& visit) const;

 private:
  static constexpr int kBlockBits = 2;
  struct Block {
    VoxelKey key = 0;
    std::uint64_t occupied = 0;  ///< Bit: the low six bits of a voxel's key. 0 = no block.
    std::size_t first = 0;       ///< Voxel of the lowest bit.
  };
  /// Place of a block, or of the free slot where it would be.
  [[nodiscard]] std::size_t slot_of(VoxelKey block) const {
    std::size_t slot = (block * 0x9E3779B97F4A7C15ULL >> 20U) & (slots_.size() - 1);
    while (slots_[slot].occupied != 0 && slots_[slot].key != block) {
      slot = (slot + 1) & (slots_.size() - 1);
    }
    return slot;
  }
  std::vector<Block> slots_;  ///< Open addressing; half of them at most are in use.
};

KeyIndex::KeyIndex(std::span<const Voxel> voxels) {
  const auto block_of = [&](std::size_t i) { return voxels[i].key >> 3 * kBlockBits; };
  std::size_t blocks = 0;
  for (std::size_t i = 0; i < voxels.size(); ++i) {
    if (i == 0 || block_of(i) != block_of(i - 1)) ++blocks;
  }
  slots_.resize(std::bit_ceil(2 * blocks + 1));
  for (std::size_t i = 0; i < voxels.size(); ++i) {
    Block& block = slots_[slot_of(block_of(i))];
    if (block.occupied == 0) block = {block_of(i), 0, i};
    block.occupied |= std::uint64_t{1} << (voxels[i].key & 63U);
  }
}

template <class Visit>
void KeyIndex::for_each_near(const glm::ivec3& cell, int reach, Visit&& visit) const {
  constexpr std::array<unsigned, 4> kSpread{0, 1, 8, 9};  // Two bits, as keys have them.
  const glm::ivec3 low = cell - reach, high = cell + reach;
  const glm::ivec3 first_block(low.x >> kBlockBits, low.y >> kBlockBits, low.z >> kBlockBits);
  std::array<const Block*, 8> blocks{};
  for (int k = 0; k < 8; ++k) {
    const glm::ivec3 corner = (first_block + glm::ivec3(k & 1, k >> 1 & 1, k >> 2)) * 4;
    if (corner.x > high.x || corner.y > high.y || corner.z > high.z) continue;
    blocks[static_cast<std::size_t>(k)] =
        &slots_[slot_of(voxel_key(corner) >> 3 * kBlockBits)];
  }
  for (int z = low.z; z <= high.z; ++z) {
    for (int y = low.y; y <= high.y; ++y) {
      const int row =
          ((z >> kBlockBits) - first_block.z) * 4 + ((y >> kBlockBits) - first_block.y) * 2;
      const unsigned row_bit = kSpread[static_cast<unsigned>(y) & 3U] * 2 +
                               kSpread[static_cast<unsigned>(z) & 3U] * 4;
      for (int x = low.x; x <= high.x; ++x) {
        const Block& block =
            *blocks[static_cast<std::size_t>(row + (x >> kBlockBits) - first_block.x)];
        const std::uint64_t bit = std::uint64_t{1}
                                  << (row_bit + kSpread[static_cast<unsigned>(x) & 3U]);
        if ((block.occupied & bit) == 0) continue;
        visit(block.first +
              static_cast<std::size_t>(std::popcount(block.occupied & (bit - 1))));
      }
    }
  }
}

core::Image<float> nearest_depth(const core::Image<float>& depth_m) {
  core::Image<float> nearest(depth_m.width_px(), depth_m.height_px(),
                             std::numeric_limits<float>::quiet_NaN());
  for (int y = 1; y + 1 < depth_m.height_px(); ++y) {
    for (int x = 1; x + 1 < depth_m.width_px(); ++x) {
      int valid = 0;
      float least = std::numeric_limits<float>::max();
      for (int k = 0; k < 9; ++k) {
        const float z = depth_m(x + k % 3 - 1, y + k / 3 - 1);
        if (!(z > 0.0F)) continue;
        ++valid;
        least = std::min(least, z);
      }
      if (valid >= 5) nearest(x, y) = least;
    }
  }
  return nearest;
}

/// Removes the marked voxels, keeping the order. @return how many.
std::size_t remove_marked(std::vector<Voxel>& voxels, const std::vector<char>& marked) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < voxels.size(); ++i) {
    if (!marked[i]) voxels[kept++] = voxels[i];
  }
  const std::size_t removed = voxels.size() - kept;
  voxels.resize(kept);
  return removed;
}

/// Weighted plane through the neighbours of voxel i; moves its centre of mass onto it.
glm::vec3 project_on_plane(const std::vector<Voxel>& voxels, const KeyIndex& index,
                           std::size_t i, float voxel_m) {
  const glm::vec3 center = voxels[i].position_m(voxel_m);
  const glm::vec3 facing = glm::normalize(voxels[i].normal_sum);
  const glm::ivec3 cell = voxel_cell(voxels[i].key);
  const float falloff = 1.0F / (2.0F * 1.5F * 1.5F * voxel_m * voxel_m);
  double total = 0.0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  int count = 0;
  index.for_each_near(cell, 2, [&](std::size_t n) {
    const Voxel& neighbor = voxels[n];
    const float length = glm::length(neighbor.normal_sum);
    if (glm::dot(neighbor.normal_sum, facing) < 0.4F * length) return;
    const glm::vec3 d = neighbor.position_m(voxel_m) - center;
    const double w = neighbor.weight * std::exp(-falloff * glm::dot(d, d));
    const Eigen::Vector3d e(d.x, d.y, d.z);
    total += w;
    sum += w * e;
    squares += w * e * e.transpose();
    ++count;
  });
  if (count < 6 || !(total > 0.0)) return center;
  const Eigen::Vector3d mean = sum / total;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(squares / total - mean * mean.transpose());
  const Eigen::Vector3d spread = solver.eigenvalues();
  if (!(spread[0] < 0.35 * spread[1])) return center;  // No plane: foliage, a corner, a leg.
  const Eigen::Vector3d normal = solver.eigenvectors().col(0);
  const double limit = 1.5 * voxel_m;
  const Eigen::Vector3d move = std::clamp(normal.dot(mean), -limit, limit) * normal;
  return center + glm::vec3(move.x(), move.y(), move.z());
}

}  // namespace

FreeSpace::FreeSpace(const RgbdSequence& sequence, std::span<const std::size_t> frames,
                     int count, const LiftOptions& options)
    : max_depth_m_(static_cast<float>(options.max_depth_m)) {
  const std::size_t views = std::min<std::size_t>(frames.size(), std::max(0, count));
  views_.resize(views);
  renderer::internal::parallel_for_each(views, 1, [&](std::size_t v) {
    const RgbdFrame frame = sequence.load(frames[v * frames.size() / views]);
    View& view = views_[v];
    view.camera =
        sequence.intrinsics().resized(frame.depth_m.width_px(), frame.depth_m.height_px());
    view.R_camera_world =
        glm::mat3(glm::mat3_cast(glm::conjugate(frame.T_world_camera.rotation())));
    view.position_m = glm::vec3(frame.T_world_camera.translation_m());
    view.depth_m = nearest_depth(frame.depth_m);
  });
}

FreeSpace::Evidence FreeSpace::at(const glm::vec3& position_m) const {
  Evidence evidence;
  for (const View& view : views_) {
    const glm::vec3 p = view.R_camera_world * (position_m - view.position_m);
    if (p.z < 0.1F || p.z > max_depth_m_) continue;
    const glm::dvec2 px = view.camera.project(p);
    if (!(px.x >= 0.0 && px.y >= 0.0 && px.x < view.camera.width_px &&
          px.y < view.camera.height_px)) {
      continue;
    }
    const float depth = view.depth_m(static_cast<int>(px.x), static_cast<int>(px.y));
    const float behind = depth - p.z;  // NaN fails both comparisons.
    const float tolerance = kThrough_m + kThroughRatio * p.z;
    if (behind > tolerance) ++evidence.through;
    if (std::abs(behind) <= tolerance) ++evidence.support;
  }
  return evidence;
}

std::size_t carve(std::vector<Voxel>& voxels, const FreeSpace& free_space, float voxel_m) {
  std::vector<char> marked(voxels.size(), 0);
  renderer::internal::parallel_for_each(voxels.size(), 1024, [&](std::size_t i) {
    const FreeSpace::Evidence seen = free_space.at(voxels[i].position_m(voxel_m));
    marked[i] = seen.through >= kFewestThrough && seen.through > seen.support ? 1 : 0;
  });
  return remove_marked(voxels, marked);
}

std::vector<Voxel> thin_surfaces(const std::vector<Voxel>& voxels, float voxel_m) {
  const KeyIndex index(voxels);
  std::vector<glm::vec3> positions_m(voxels.size());
  renderer::internal::parallel_for_each(voxels.size(), 1024, [&](std::size_t i) {
    positions_m[i] = project_on_plane(voxels, index, i, voxel_m);
  });
  return refuse_voxels(voxels, positions_m, voxel_m);
}

std::size_t remove_sparse(std::vector<Voxel>& voxels, int min_observations) {
  return std::erase_if(voxels, [&](const Voxel& voxel) {
    return voxel.observations < static_cast<std::uint32_t>(std::max(1, min_observations)) ||
           !(glm::dot(voxel.normal_sum, voxel.normal_sum) > 0.0F);
  });
}

std::size_t remove_islands(std::vector<Voxel>& voxels, std::size_t fewest) {
  const KeyIndex index(voxels);
  std::vector<char> seen(voxels.size(), 0), marked(voxels.size(), 0);
  std::vector<std::size_t> island;
  for (std::size_t first = 0; first < voxels.size(); ++first) {
    if (seen[first]) continue;
    seen[first] = 1;
    island.assign(1, first);
    for (std::size_t next = 0; next < island.size(); ++next) {
      index.for_each_near(voxel_cell(voxels[island[next]].key), 1, [&](std::size_t n) {
        if (seen[n]) return;
        seen[n] = 1;
        island.push_back(n);
      });
    }
    if (island.size() >= fewest) continue;
    for (const std::size_t i : island) marked[i] = 1;
  }
  return remove_marked(voxels, marked);
}

}  // namespace segsim::reconstruction::internal
