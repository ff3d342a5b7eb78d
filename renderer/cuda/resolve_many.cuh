#pragma once

/// @file
/// Labels of pixels whose many surfels do not agree: sums of scores in a small table of the
/// thread, which takes the place of records that are no longer needed. What resolve.cuh does
/// for a few surfels in registers, pair by pair.

#include <cstdint>

#include "renderer/cuda/resolve.cuh"

namespace segsim::renderer::cuda {

/// Sums of scores by index, in the order in which indices come.
class ScoreTable {
 public:
  static constexpr int kSlots = 21;
  static_assert(kSlots * (sizeof(float) + sizeof(std::uint16_t)) * kTileThreads <=
                TileShared::kStagedBytes);

  /// Overwrites staged records. @pre No warp of the block reads or writes them.
  __device__ explicit ScoreTable(TileShared& shared)
      : sums_(reinterpret_cast<float*>(shared.centre_m0) + threadIdx.x),
        indices_(reinterpret_cast<std::uint16_t*>(reinterpret_cast<float*>(shared.centre_m0) +
                                                  kSlots * kTileThreads) +
                 threadIdx.x) {}

  __device__ void add(std::uint32_t index, float score) {
    int slot = 0;
    while (slot < count_ && indices_[slot * kTileThreads] != index) ++slot;
    if (slot < count_) {
      sums_[slot * kTileThreads] += score;
    } else if (count_ < kSlots) {
      indices_[slot * kTileThreads] = static_cast<std::uint16_t>(index);
      sums_[slot * kTileThreads] = score;
      ++count_;
    } else {
      overflown_ = true;
    }
  }
  [[nodiscard]] __device__ bool overflown() const { return overflown_; }
  [[nodiscard]] __device__ Best best() const {
    Best best;
    for (int slot = 0; slot < count_; ++slot) {
      best.consider(indices_[slot * kTileThreads], sums_[slot * kTileThreads]);
    }
    return best;
  }
  /// The largest sum of the others.
  [[nodiscard]] __device__ float runner_up(std::uint32_t winner) const {
    float sum = 0.0F;
    for (int slot = 0; slot < count_; ++slot) {
      if (indices_[slot * kTileThreads] != winner)
        sum = fmaxf(sum, sums_[slot * kTileThreads]);
    }
    return sum;
  }

 private:
  float* sums_;
  std::uint16_t* indices_;
  int count_ = 0;
  bool overflown_ = false;
};

/// The index with the largest sum of scores, ties to the lower.
/// @param each  Calls a function for every (index, score).
template <class Each>
__device__ Best best_of(const Each& each, TileShared& shared) {
  // Where more indices meet than the table holds, a part of them is looked at at a time.
  for (std::uint32_t parts = 1;; parts *= 4) {
    Best best;
    bool overflown = false;
    for (std::uint32_t part = 0; part < parts && !overflown; ++part) {
      ScoreTable table(shared);
      each([&](std::uint32_t index, float score) {
        if (index % parts == part) table.add(index, score);
      });
      overflown = table.overflown();
      const Best of_part = table.best();
      best.consider(of_part.index, of_part.sum);
    }
    if (!overflown) return best;
  }
}

__device__ inline Label vote_labels(const ManySelected& selected,
                                    const std::uint32_t* label_of) {
  if (selected.count == 0) return {};
  const auto load = [&](std::uint32_t surfel) { return label_of[surfel]; };
  std::uint32_t first = 0;
  bool unanimous = true;
  for_each_surfel(selected, load, [&](int i, float, std::uint32_t label) {
    if (i == 0) first = label;
    unanimous = unanimous && label == first;
  });
  if (unanimous) {
    return {static_cast<std::uint16_t>(first & 0xFFFFU),
            static_cast<std::uint16_t>(first >> 16U), 1.0F, 1.0F};
  }
  const auto half_of_labels = [&](int shift) {
    return best_of(
        [&](const auto& take) {
          for_each_surfel(selected, load, [&](int, float weight, std::uint32_t label) {
            take(label >> shift & 0xFFFFU, weight);
          });
        },
        *selected.shared);
  };
  const Best semantic = half_of_labels(0), instance = half_of_labels(16);
  return {static_cast<std::uint16_t>(semantic.index),
          static_cast<std::uint16_t>(instance.index), semantic.sum / selected.total,
          instance.sum / selected.total};
}

/// Rows lead with their largest entry: mostly the sums of those decide already.
__device__ inline Best best_of_rows(const ManySelected& selected, const PanopticView& field,
                                    FieldPart part, float next) {
  const PanopticRows& rows = rows_of(field, part);
  const auto load = [&](std::uint32_t surfel) { return lead_of(field.head[surfel], part); };
  ScoreTable leads(*selected.shared);
  for_each_surfel(selected, load, [&](int, float weight, const Lead& lead) {
    if (lead.index != kNoIndex) leads.add(lead.index, weight * lead.score);
  });
  const Best best = leads.best();
  if (!leads.overflown() && best.sum > leads.runner_up(best.index) + next) {
    return {best.index, sum_of(selected, rows, best.index)};
  }
  return best_of(
      [&](const auto& take) {
        for (int i = 0; i < selected.count; ++i) {
          const float weight = selected.weight(i);
          const std::size_t at = static_cast<std::size_t>(selected.id(i)) * rows.capacity;
          for (int e = 0; e < rows.capacity; ++e) {
            const std::uint32_t index = rows.index[at + e];
            if (index == kNoIndex) break;
            take(index, weight * rows.score[at + e]);
          }
        }
      },
      *selected.shared);
}

}  // namespace segsim::renderer::cuda
