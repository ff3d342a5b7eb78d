#pragma once

/// @file
/// Which query explains which mask of a frame (paper, "Instance Query Alignment").

#include <vector>

#include "reconstruction/labels/internal/head_support.h"

namespace segsim::reconstruction::internal {

struct Matching {
  std::vector<std::int64_t> queries;   ///< Of the pairs.
  std::vector<std::int64_t> masks;     ///< Of the pairs, index in BatchTargets::masks.
  std::vector<std::int64_t> query_of;  ///< [masks], -1 = none.
  std::vector<bool> visible;           ///< [queries]: wins pixels of this frame.
};

/// Pairs with the smallest sum of dice + bce - class_cost * P(class of the mask). Nothing is
/// differentiated.
/// @param mask  [n, queries], rendered at masks.pixels.  @param class_logits  [queries, T +
/// 1].
/// @param gated  Pairs with a dice loss above max_dice are taken back.
[[nodiscard]] Matching match_queries(const Tensor& mask, const Tensor& class_logits,
                                     const BatchTargets& targets, const MaskTargets& masks,
                                     const ClassSplit& classes, const QueryConfig& config,
                                     bool gated);

}  // namespace segsim::reconstruction::internal
