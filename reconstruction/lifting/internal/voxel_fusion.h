#pragma once

/// @file
/// Hash of voxels that gather surface samples.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>

#include "reconstruction/lifting/internal/lift_frame.h"

namespace segsim::reconstruction::internal {

/// Morton code of a voxel, 21 bits per axis: neighbours in space are near in a sorted list.
using VoxelKey = std::uint64_t;
[[nodiscard]] VoxelKey voxel_key(const glm::ivec3& cell);
[[nodiscard]] glm::ivec3 voxel_cell(VoxelKey key);
[[nodiscard]] VoxelKey voxel_key_at(const glm::vec3& position_m, float voxel_m);
/// Half the edge of the cube around the origin that keys cover, in voxels.
inline constexpr int kVoxelRange = 1 << 20;

/// Most frequent labels of a voxel, counted in four slots (Misra and Gries 1982): a label with
/// more than a fifth of the votes is always among them.
struct LabelVotes {
  static constexpr int kSlots = 4;
  std::array<LabelPair, kSlots> label{};
  std::array<float, kSlots> votes{};
  float total = 0.0F;

  void add(LabelPair label_to_add, float weight);
  void add(const LabelVotes& other);
  /// Slot with the most votes, the lower label on a tie.
  [[nodiscard]] int winner() const;
};

struct Voxel {
  VoxelKey key = 0;
  glm::vec3 position_sum{0.0F};  ///< Weighted, relative to the origin of the cell's corner.
  float weight = 0.0F;
  glm::vec3 color_sum{0.0F};
  float color_weight = 0.0F;
  glm::vec3 normal_sum{0.0F};  ///< Weighted unit normals towards the cameras.
  std::uint32_t observations = 0;
  LabelVotes labels;

  [[nodiscard]] glm::vec3 position_m(float voxel_m) const;
  [[nodiscard]] glm::vec3 color() const { return color_sum / color_weight; }
};

/// Open-addressing hash table.
class VoxelTable {
 public:
  /// The voxel with this key, made if absent. Valid until the next call.
  Voxel& at(VoxelKey key);
  /// Into voxels(); -1 if absent.
  [[nodiscard]] std::int64_t find(VoxelKey key) const;
  [[nodiscard]] const std::vector<Voxel>& voxels() const { return voxels_; }
  /// Moves the voxels out, in order of insertion; the table is empty afterwards.
  [[nodiscard]] std::vector<Voxel> take();

 private:
  void grow();
  std::vector<Voxel> voxels_;
  std::vector<std::uint32_t>
      slots_;  ///< Index + 1 into voxels_; 0 = free. Size is a power of two.
};

/// Tables split by key, so that several threads add at once and every voxel still receives its
/// samples in frame order.
class VoxelFusion {
 public:
  explicit VoxelFusion(float voxel_m) : voxel_m_(voxel_m), shards_(kShards) {}

  /// Adds the frames of one batch, in order.
  void add(std::span<const FrameSamples> frames);
  /// All voxels in ascending order of key; the object is empty afterwards.
  [[nodiscard]] std::vector<Voxel> take_sorted();

 private:
  static constexpr std::size_t kShards = 16;
  float voxel_m_;
  std::vector<VoxelTable> shards_;
};

/// Adds a sample or a whole voxel whose centre of mass is `position_m` (inside the cell).
void add_sample(Voxel& voxel, const LiftSample& sample, float voxel_m);
void add_moved(Voxel& voxel, const Voxel& moved, const glm::vec3& position_m, float voxel_m);

/// Puts every voxel at its new position; those that fall into one cell are merged. `voxels`
/// and the result are in ascending order of key.
[[nodiscard]] std::vector<Voxel> refuse_voxels(std::span<const Voxel> voxels,
                                               std::span<const glm::vec3> positions_m,
                                               float voxel_m);

}  // namespace segsim::reconstruction::internal
