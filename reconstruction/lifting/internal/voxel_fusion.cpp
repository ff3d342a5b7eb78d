#include "reconstruction/lifting/internal/voxel_fusion.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <glm/common.hpp>

#include "core/check.h"
#include "renderer/scene/parallel.h"

namespace segsim::reconstruction::internal {
namespace {

/// Inserts two zero bits before each of the 21 low bits.
constexpr std::uint64_t spread_bits(std::uint64_t v) {
  v &= 0x1FFFFFULL;
  v = (v | (v << 32U)) & 0x1F00000000FFFFULL;
  v = (v | (v << 16U)) & 0x1F0000FF0000FFULL;
  v = (v | (v << 8U)) & 0x100F00F00F00F00FULL;
  v = (v | (v << 4U)) & 0x10C30C30C30C30C3ULL;
  return (v | (v << 2U)) & 0x1249249249249249ULL;
}

constexpr std::uint64_t gather_bits(std::uint64_t v) {
  v &= 0x1249249249249249ULL;
  v = (v | (v >> 2U)) & 0x10C30C30C30C30C3ULL;
  v = (v | (v >> 4U)) & 0x100F00F00F00F00FULL;
  v = (v | (v >> 8U)) & 0x1F0000FF0000FFULL;
  v = (v | (v >> 16U)) & 0x1F00000000FFFFULL;
  return (v | (v >> 32U)) & 0x1FFFFFULL;
}

std::uint64_t mix(std::uint64_t v) {
  v *= 0x9E3779B97F4A7C15ULL;  // Fibonacci hashing; the high bits are the good ones.
  return v ^ (v >> 32U);
}

glm::vec3 corner_m(VoxelKey key, float voxel_m) {
  return glm::vec3(voxel_cell(key)) * voxel_m;
}

}  // namespace

VoxelKey voxel_key(const glm::ivec3& cell) {
  return spread_bits(static_cast<std::uint64_t>(cell.x + kVoxelRange)) |
         (spread_bits(static_cast<std::uint64_t>(cell.y + kVoxelRange)) << 1U) |
         (spread_bits(static_cast<std::uint64_t>(cell.z + kVoxelRange)) << 2U);
}

glm::ivec3 voxel_cell(VoxelKey key) {
  return glm::ivec3(static_cast<int>(gather_bits(key)),
                    static_cast<int>(gather_bits(key >> 1U)),
                    static_cast<int>(gather_bits(key >> 2U))) -
         kVoxelRange;
}

VoxelKey voxel_key_at(const glm::vec3& position_m, float voxel_m) {
  return voxel_key(glm::ivec3(glm::floor(position_m / voxel_m)));
}

void LabelVotes::add(LabelPair label_to_add, float weight) {
  total += weight;
  int lowest = 0;
  for (int i = 0; i < kSlots; ++i) {
    if (votes[i] > 0.0F && label[i] == label_to_add) {
      votes[i] += weight;
      return;
    }
    if (votes[i] < votes[lowest]) lowest = i;
  }
  if (votes[lowest] <= 0.0F) {
    label[lowest] = label_to_add;
    votes[lowest] = weight;
    return;
  }
  // All slots are taken: the newcomer and every holder lose the same amount.
  const float loss = std::min(weight, votes[lowest]);
  for (float& vote : votes) vote -= loss;
  if (weight > loss) {
    label[lowest] = label_to_add;
    votes[lowest] = weight - loss;
  }
}

void LabelVotes::add(const LabelVotes& other) {
  const float sum = total + other.total;
  for (int i = 0; i < kSlots; ++i) {
    if (other.votes[i] > 0.0F) add(other.label[i], other.votes[i]);
  }
  total = sum;  // Includes what the other table had already cancelled.
}

int LabelVotes::winner() const {
  int best = 0;
  for (int i = 1; i < kSlots; ++i) {
    if (votes[i] > votes[best] || (votes[i] == votes[best] && label[i] < label[best]))
      best = i;
  }
  return best;
}

glm::vec3 Voxel::position_m(float voxel_m) const {
  return corner_m(key, voxel_m) + position_sum / weight;
}

Voxel& VoxelTable::at(VoxelKey key) {
  if (2 * (voxels_.size() + 1) > slots_.size()) grow();
  const std::size_t mask = slots_.size() - 1;
  for (std::size_t slot = mix(key) & mask;; slot = (slot + 1) & mask) {
    if (slots_[slot] == 0) {
      voxels_.emplace_back();
      voxels_.back().key = key;
      slots_[slot] = static_cast<std::uint32_t>(voxels_.size());
      return voxels_.back();
    }
    if (Voxel& voxel = voxels_[slots_[slot] - 1]; voxel.key == key) return voxel;
  }
}

std::int64_t VoxelTable::find(VoxelKey key) const {
  if (slots_.empty()) return -1;
  const std::size_t mask = slots_.size() - 1;
  for (std::size_t slot = mix(key) & mask; slots_[slot] != 0; slot = (slot + 1) & mask) {
    if (voxels_[slots_[slot] - 1].key == key) return slots_[slot] - 1;
  }
  return -1;
}

std::vector<Voxel> VoxelTable::take() {
  slots_.clear();
  return std::exchange(voxels_, {});
}

void VoxelTable::grow() {
  const std::size_t size = std::max<std::size_t>(1024, 2 * slots_.size());
  slots_.assign(size, 0);
  for (std::size_t i = 0; i < voxels_.size(); ++i) {
    std::size_t slot = mix(voxels_[i].key) & (size - 1);
    while (slots_[slot] != 0) slot = (slot + 1) & (size - 1);
    slots_[slot] = static_cast<std::uint32_t>(i + 1);
  }
}

void add_sample(Voxel& voxel, const LiftSample& sample, float voxel_m) {
  voxel.position_sum += sample.weight * (sample.position_m - corner_m(voxel.key, voxel_m));
  voxel.weight += sample.weight;
  voxel.color_sum += sample.color_weight * sample.color;
  voxel.color_weight += sample.color_weight;
  voxel.normal_sum += sample.weight * sample.normal;
  ++voxel.observations;
  voxel.labels.add(sample.label, sample.weight);
}

void add_moved(Voxel& voxel, const Voxel& moved, const glm::vec3& position_m, float voxel_m) {
  voxel.position_sum += moved.weight * (position_m - corner_m(voxel.key, voxel_m));
  voxel.weight += moved.weight;
  voxel.color_sum += moved.color_sum;
  voxel.color_weight += moved.color_weight;
  voxel.normal_sum += moved.normal_sum;
  voxel.observations += moved.observations;
  voxel.labels.add(moved.labels);
}

void VoxelFusion::add(std::span<const FrameSamples> frames) {
  struct Entry {
    VoxelKey key;
    std::uint32_t sample;
  };
  std::vector<std::array<std::vector<Entry>, kShards>> entries(frames.size());
  renderer::internal::parallel_for_each(frames.size(), 1, [&](std::size_t f) {
    const std::vector<LiftSample>& samples = frames[f].samples;
    for (std::uint32_t i = 0; i < samples.size(); ++i) {
      const VoxelKey key = voxel_key_at(samples[i].position_m, voxel_m_);
      entries[f][mix(key) >> 60U].push_back({key, i});
    }
  });
  renderer::internal::parallel_for_each(kShards, 1, [&](std::size_t s) {
    for (std::size_t f = 0; f < frames.size(); ++f) {
      for (const Entry& entry : entries[f][s]) {
        add_sample(shards_[s].at(entry.key), frames[f].samples[entry.sample], voxel_m_);
      }
    }
  });
}

std::vector<Voxel> VoxelFusion::take_sorted() {
  std::vector<Voxel> all;
  for (VoxelTable& shard : shards_) {
    const std::vector<Voxel> voxels = shard.take();
    all.insert(all.end(), voxels.begin(), voxels.end());
  }
  std::sort(all.begin(), all.end(),
            [](const Voxel& a, const Voxel& b) { return a.key < b.key; });
  return all;
}

std::vector<Voxel> refuse_voxels(std::span<const Voxel> voxels,
                                 std::span<const glm::vec3> positions_m, float voxel_m) {
  SEGSIM_CHECK(voxels.size() == positions_m.size(), std::to_string(positions_m.size()));
  VoxelTable table;
  for (std::size_t i = 0; i < voxels.size(); ++i) {
    add_moved(table.at(voxel_key_at(positions_m[i], voxel_m)), voxels[i], positions_m[i],
              voxel_m);
  }
  std::vector<Voxel> merged = table.take();
  std::sort(merged.begin(), merged.end(),
            [](const Voxel& a, const Voxel& b) { return a.key < b.key; });
  return merged;
}

}  // namespace segsim::reconstruction::internal
