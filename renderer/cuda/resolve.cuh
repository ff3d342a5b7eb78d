#pragma once

/// @file
/// From the surfels that a pixel selected to its labels and features: the deferred half of the
/// paper's Top-K Hard Selection, as internal/label_resolve.h and label_vote.h have it.

#include <cstdint>

#include "renderer/cuda/device_data.h"

namespace segsim::renderer::cuda {

/// Loops over a few surfels are written out, those over many are not.
template <int kCapacity>
inline constexpr int kUnroll = kCapacity <= 4 ? kCapacity : 1;

/// A pixel's surfels; kCapacity is at least their number.
template <int kCapacity>
struct Selected {
  float weight[kCapacity];
  std::uint32_t id[kCapacity];  ///< Index in the cloud.
  int count = 0;
  float total = 0.0F;
};

struct Label {
  std::uint16_t semantic = 0, instance = 0;
  float confidence = 0.0F, instance_confidence = 0.0F;
};

/// The value with the largest summed weight, ties to the lower.
template <int kCapacity>
__device__ void vote(const Selected<kCapacity>& selected, const std::uint32_t* label,
                     int shift, std::uint16_t& winner, float& share) {
  std::uint32_t best = 0;
  float best_weight = -1.0F;
#pragma unroll kUnroll < kCapacity>
  for (int i = 0; i < kCapacity; ++i) {
    if (i >= selected.count) break;
    const std::uint32_t candidate = label[i] >> shift & 0xFFFFU;
    float weight = 0.0F;
#pragma unroll kUnroll < kCapacity>
    for (int j = 0; j < kCapacity; ++j) {
      if (j < selected.count && (label[j] >> shift & 0xFFFFU) == candidate) {
        weight += selected.weight[j];
      }
    }
    if (weight > best_weight || (weight == best_weight && candidate < best)) {
      best = candidate;
      best_weight = weight;
    }
  }
  winner = static_cast<std::uint16_t>(best);
  share = best_weight / selected.total;
}

template <int kCapacity>
__device__ Label vote_labels(const Selected<kCapacity>& selected,
                             const std::uint32_t* label_of) {
  Label result;
  if (selected.count == 0) return result;
  std::uint32_t label[kCapacity];
  bool unanimous = true;
#pragma unroll kUnroll < kCapacity>
  for (int i = 0; i < kCapacity; ++i) {
    if (i >= selected.count) break;
    label[i] = label_of[selected.id[i]];
    unanimous = unanimous && label[i] == label[0];
  }
  if (unanimous) {
    return {static_cast<std::uint16_t>(label[0] & 0xFFFFU),
            static_cast<std::uint16_t>(label[0] >> 16U), 1.0F, 1.0F};
  }
  vote(selected, label, 0, result.semantic, result.confidence);
  vote(selected, label, 16, result.instance, result.instance_confidence);
  return result;
}

struct Best {
  std::uint32_t index = kNoIndex;
  float sum = 0.0F;

  __device__ void consider(std::uint32_t candidate, float its_sum) {
    if (its_sum > sum || (its_sum == sum && candidate < index)) {
      index = candidate;
      sum = its_sum;
    }
  }
};

/// Score of `index` in a surfel's row; 0 if the row lacks it.
__device__ inline float score_in_row(const PanopticRows& rows, std::uint32_t surfel,
                                     std::uint32_t index) {
  const std::size_t at = static_cast<std::size_t>(surfel) * rows.capacity;
  for (int e = 0; e < rows.capacity; e += 8) {
    const uint4 eight = *reinterpret_cast<const uint4*>(rows.index + at + e);
    const std::uint32_t pair[4] = {eight.x, eight.y, eight.z, eight.w};
    int place = -1;
#pragma unroll
    for (int i = 0; i < 4; ++i) {
      if ((pair[i] & 0xFFFFU) == index) place = 2 * i;
      if (pair[i] >> 16U == index) place = 2 * i + 1;
    }
    if (place >= 0) return rows.score[at + e + place];
    if (pair[3] >> 16U == kNoIndex) break;
  }
  return 0.0F;
}

/// Sum of weight * score of `index` over all rows.
template <int kCapacity>
__device__ float sum_of(const Selected<kCapacity>& selected, const PanopticRows& rows,
                        std::uint32_t index) {
  float sum = 0.0F;
#pragma unroll kUnroll < kCapacity>
  for (int j = 0; j < kCapacity; ++j) {
    if (j >= selected.count) break;
    sum += selected.weight[j] * score_in_row(rows, selected.id[j], index);
  }
  return sum;
}

/// The largest sum of weight * score over rows that do not agree on it, ties to the lower
/// index.
/// @param head  Index of the largest entry of every row.
/// @param next  Sum of weight * second largest entry: no index that leads no row can have
/// more.
template <int kCapacity>
__device__ Best best_of_rows(const Selected<kCapacity>& selected, const PanopticRows& rows,
                             const std::uint32_t (&head)[kCapacity], float next) {
  Best best;
#pragma unroll kUnroll < kCapacity>
  for (int i = 0; i < kCapacity; ++i) {
    if (i >= selected.count) break;
    if (head[i] == kNoIndex) continue;
    bool seen = false;
#pragma unroll kUnroll < kCapacity>
    for (int j = 0; j < i; ++j) seen = seen || head[j] == head[i];
    if (!seen) best.consider(head[i], sum_of(selected, rows, head[i]));
  }
  if (best.sum > next) return best;
    // Entry by entry of all rows, until what is left cannot add up to more.
#pragma unroll 1
  for (int e = 1; e < rows.capacity; ++e) {
    next = 0.0F;
#pragma unroll 1
    for (int i = 0; i < selected.count; ++i) {
      const std::size_t at = static_cast<std::size_t>(selected.id[i]) * rows.capacity + e;
      const std::uint32_t index = rows.index[at];
      if (index == kNoIndex) continue;
      best.consider(index, sum_of(selected, rows, index));
      next += selected.weight[i] * rows.score[at];
    }
    if (best.sum > next) break;
  }
  return best;
}

template <int kCapacity>
__device__ Label resolve_panoptic(const Selected<kCapacity>& selected,
                                  const PanopticView& field) {
  Label label;
  if (selected.count == 0) return label;
  std::uint32_t classes[kCapacity], queries[kCapacity];
  Best best_class, best_query;
  bool one_class = true, one_query = true;
  float base = 0.0F, next_class = 0.0F, next_query = 0.0F;
#pragma unroll kUnroll < kCapacity>
  for (int i = 0; i < kCapacity; ++i) {
    if (i >= selected.count) break;
    const PanopticHead head = field.head[selected.id[i]];
    const float weight = selected.weight[i];
    classes[i] = head.class_index;
    queries[i] = head.query_index;
    base += weight * head.query_base;
    next_class += weight * head.next_class_score;
    next_query += weight * head.next_query_excess;
    if (head.class_index != kNoIndex) {
      one_class =
          one_class && (best_class.index == kNoIndex || best_class.index == head.class_index);
      best_class.index = head.class_index;
      best_class.sum += weight * head.class_score;
    }
    if (head.query_index != kNoIndex) {
      one_query =
          one_query && (best_query.index == kNoIndex || best_query.index == head.query_index);
      best_query.index = head.query_index;
      best_query.sum += weight * head.query_excess;
    }
  }
  // If the largest entries of all rows agree, no other index can have a larger sum.
  if (!one_class) best_class = best_of_rows(selected, field.classes, classes, next_class);
  if (best_class.index != kNoIndex) {
    label.semantic = field.class_id[best_class.index];
    label.confidence = best_class.sum / selected.total;
    if (field.class_is_thing[best_class.index] == 0) {
      label.instance_confidence = label.confidence;
      return label;
    }
  }
  if (!one_query) best_query = best_of_rows(selected, field.queries, queries, next_query);
  if (best_query.index != kNoIndex) {
    label.instance = field.query_id[best_query.index];
    label.instance_confidence = (base + best_query.sum) / selected.total;
    if (field.query_class != nullptr && field.query_class[best_query.index] != 0) {
      label.semantic = field.query_class[best_query.index];
    }
  }
  if (label.instance == 0 && field.query_class != nullptr) label.semantic = 0;
  return label;
}

/// Weighted mean of rows of kSize features.
template <int kSize, int kCapacity>
__device__ void mean_of(const Selected<kCapacity>& selected, const float* rows, float* mean) {
  const float scale = selected.count > 0 ? 1.0F / selected.total : 0.0F;
  for (int c = 0; c < kSize; ++c) {
    float sum = 0.0F;
    for (int i = 0; i < selected.count; ++i) {
      sum += selected.weight[i] * rows[static_cast<std::size_t>(selected.id[i]) * kSize + c];
    }
    mean[c] = sum * scale;
  }
}

}  // namespace segsim::renderer::cuda
