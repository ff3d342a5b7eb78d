#pragma once

/// @file
/// From the surfels that a pixel selected to its labels and features: the deferred half of the
/// paper's Top-K Hard Selection, as raster/label_resolve.h and label_vote.h have it.

#include <cstdint>

#include "renderer/cuda/selection.cuh"

namespace segsim::renderer::cuda {

struct Label {
  std::uint16_t semantic = 0, instance = 0;
  float confidence = 0.0F, instance_confidence = 0.0F;
};

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

/// The kept number with the largest summed weight, ties to the lower.
__device__ inline void vote(const FewSelected& selected, int which, std::uint16_t& winner,
                            float& share) {
  std::uint32_t best = 0;
  float best_weight = -1.0F;
#pragma unroll
  for (int i = 0; i < kFewKeys; ++i) {
    if (i >= selected.count) break;
    const std::uint32_t candidate = selected.kept(which, i);
    float weight = 0.0F;
#pragma unroll
    for (int j = 0; j < kFewKeys; ++j) {
      if (j < selected.count && selected.kept(which, j) == candidate) {
        weight += selected.weight(j);
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

/// Loops end at the capacity: with a constant end they can be written out.
__device__ inline Label vote_labels(FewSelected& selected, const std::uint32_t* label_of) {
  Label result;
  if (selected.count == 0) return result;
  std::uint32_t first = 0;
  bool unanimous = true;
#pragma unroll
  for (int i = 0; i < kFewKeys; ++i) {
    if (i >= selected.count) break;
    const std::uint32_t label = label_of[selected.id(i)];
    if (i == 0) first = label;
    unanimous = unanimous && label == first;
    selected.keep(0, i, label & 0xFFFFU);
    selected.keep(1, i, label >> 16U);
  }
  if (unanimous) {
    return {static_cast<std::uint16_t>(first & 0xFFFFU),
            static_cast<std::uint16_t>(first >> 16U), 1.0F, 1.0F};
  }
  vote(selected, 0, result.semantic, result.confidence);
  vote(selected, 1, result.instance, result.instance_confidence);
  return result;
}

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
template <class Selected>
__device__ float sum_of(const Selected& selected, const PanopticRows& rows,
                        std::uint32_t index) {
  float sum = 0.0F;
  for_each_surfel(
      selected, [&](std::uint32_t surfel) { return score_in_row(rows, surfel, index); },
      [&](int, float weight, float score) { sum += weight * score; });
  return sum;
}

/// What a field says twice of every surfel.
enum class FieldPart : int { kClasses, kQueries };
__device__ inline const PanopticRows& rows_of(const PanopticView& field, FieldPart part) {
  return part == FieldPart::kClasses ? field.classes : field.queries;
}
/// The largest entry of a surfel's row.
struct Lead {
  std::uint32_t index;
  float score;
};
__device__ inline Lead lead_of(const PanopticHead& head, FieldPart part) {
  return part == FieldPart::kClasses ? Lead{head.class_index, head.class_score}
                                     : Lead{head.query_index, head.query_excess};
}

/// The largest sum of weight * score over rows that do not agree on it, ties to the lower
/// index.
/// @pre The surfels' kept numbers are the indices of the rows' largest entries.
/// @param next  Sum of weight * second largest entry: no index that leads no row can have
/// more.
__device__ inline Best best_of_rows(const FewSelected& selected, const PanopticView& field,
                                    FieldPart part, float next) {
  const PanopticRows& rows = rows_of(field, part);
  const int heads = static_cast<int>(part);
  Best best;
#pragma unroll
  for (int i = 0; i < kFewKeys; ++i) {
    if (i >= selected.count) break;
    const std::uint32_t head = selected.kept(heads, i);
    if (head == kNoIndex) continue;
    bool seen = false;
#pragma unroll
    for (int j = 0; j < i; ++j) seen = seen || selected.kept(heads, j) == head;
    if (!seen) best.consider(head, sum_of(selected, rows, head));
  }
  if (best.sum > next) return best;
    // Entry by entry of all rows, until what is left cannot add up to more.
#pragma unroll 1
  for (int e = 1; e < rows.capacity; ++e) {
    next = 0.0F;
#pragma unroll 1
    for (int i = 0; i < selected.count; ++i) {
      const std::size_t at = static_cast<std::size_t>(selected.id(i)) * rows.capacity + e;
      const std::uint32_t index = rows.index[at];
      if (index == kNoIndex) continue;
      best.consider(index, sum_of(selected, rows, index));
      next += selected.weight(i) * rows.score[at];
    }
    if (best.sum > next) break;
  }
  return best;
}

template <class Selected>
__device__ Label resolve_panoptic(Selected& selected, const PanopticView& field) {
  constexpr FieldPart kClasses = FieldPart::kClasses, kQueries = FieldPart::kQueries;
  Label label;
  if (selected.count == 0) return label;
  Best best_class, best_query;
  bool one_class = true, one_query = true;
  float base = 0.0F, next_class = 0.0F, next_query = 0.0F;
  const auto take = [&](int i, float weight, const PanopticHead& head) {
    selected.keep(static_cast<int>(kClasses), i, head.class_index);
    selected.keep(static_cast<int>(kQueries), i, head.query_index);
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
  };
  for_each_surfel(
      selected, [&](std::uint32_t surfel) { return field.head[surfel]; }, take);
  // If the largest entries of all rows agree, no other index can have a larger sum.
  if (!one_class) best_class = best_of_rows(selected, field, kClasses, next_class);
  if (best_class.index != kNoIndex) {
    label.semantic = field.class_id[best_class.index];
    label.confidence = best_class.sum / selected.total;
    if (field.class_is_thing[best_class.index] == 0) {
      label.instance_confidence = label.confidence;
      return label;
    }
  }
  if (!one_query) best_query = best_of_rows(selected, field, kQueries, next_query);
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

template <int kFours>
struct FeaturePart {
  float4 four[kFours];
};

/// Weighted mean of rows of kSize features: four channels of all surfels, then the next four.
/// Of many surfels sixteen, because finding their rows takes time.
template <int kSize, class Selected>
__device__ void mean_of(const Selected& selected, const float* rows, float* mean) {
  constexpr int kFours = Selected::kCapacity <= kFewKeys ? 1 : 4;
  using Part = FeaturePart<kFours>;
  constexpr int kParts = kSize / 4 / kFours;
  const float scale = selected.count > 0 ? 1.0F / selected.total : 0.0F;
  for (int p = 0; p < kParts; ++p) {
    Part sum{};
    for_each_surfel(
        selected,
        [&](std::uint32_t surfel) {
          return reinterpret_cast<const Part*>(
              rows)[static_cast<std::size_t>(surfel) * kParts + p];
        },
        [&](int, float weight, const Part& part) {
          const float share = weight * scale;
#pragma unroll
          for (int c = 0; c < kFours; ++c) {
            sum.four[c].x = fmaf(share, part.four[c].x, sum.four[c].x);
            sum.four[c].y = fmaf(share, part.four[c].y, sum.four[c].y);
            sum.four[c].z = fmaf(share, part.four[c].z, sum.four[c].z);
            sum.four[c].w = fmaf(share, part.four[c].w, sum.four[c].w);
          }
        });
    reinterpret_cast<Part*>(mean)[p] = sum;
  }
}

}  // namespace segsim::renderer::cuda
