#pragma once

/// @file
/// What heads of queries have in common: losses of queries and the masks that they were
/// matched with (paper, "Loss Function Details"; PanopticRecon++), and how queries are used.

#include <vector>

#include "reconstruction/labels/internal/query_matching.h"
#include "reconstruction/labels/internal/query_set.h"
#include "reconstruction/labels/internal/sparse_blend.h"
#include "reconstruction/labels/query_pruning.h"

namespace segsim::reconstruction::internal {

/// Negative log likelihood of the class of each labelled pixel.
/// @param classes  [surfels, classes], probabilities.
/// @return  [pixels], blended probability of each pixel's class; 0 without one.
Tensor add_semantic_loss(LossSum& sum, double factor, const BlendMatrix& matrix,
                         const Tensor& classes, const BatchTargets& targets);

struct InstanceFactors {
  double dice, bce;
};
/// Of the matched queries, in the mean.
/// @param blended  [pixels, queries].  @param masks  The pixels that take part.
void add_instance_losses(LossSum& sum, const Tensor& blended, const Matching& matching,
                         const MaskTargets& masks, const InstanceFactors& factors);

/// Pixels but those of masks that got no query.
[[nodiscard]] std::vector<std::int64_t> without_unmatched(
    const std::vector<std::int64_t>& pixels, const BatchTargets& targets,
    const Matching& matching);

/// Matched queries learn the class of their mask; unmatched ones that win pixels here learn
/// that they are nothing. What the frame does not show learns nothing.
/// @param class_logits  [queries, T + 1].
[[nodiscard]] Tensor query_class_loss(const Tensor& class_logits, const BatchTargets& targets,
                                      const Matching& matching, const ClassSplit& classes,
                                      double no_object);

/// [surfels, stuff classes]. @param classes  [surfels, classes], probabilities.
[[nodiscard]] Tensor stuff_rows(const Tensor& classes, const ClassSplit& split);

struct PanopticRows {
  Tensor classes;  ///< [surfels, classes], probabilities.
  Tensor shares;   ///< [surfels, queries], what of a surfel's thing mass each query has.
};
/// The parameter-free panoptic head: P(stuff c) = p_c, P(q) = (1 - sum of stuff) l_q, blended.
/// Pixels of masks without a query are left out: PanopticRecon++ shifts them to the last stuff
/// class by mistake.
/// @param class_probability  Of add_semantic_loss().
/// @return  Undefined if no pixel takes part.
[[nodiscard]] Tensor panoptic_loss(const BlendMatrix& matrix, const PanopticRows& rows,
                                   const Tensor& class_probability,
                                   const BatchTargets& targets, const Matching& matching,
                                   const ClassSplit& classes);

/// Of every query: its matches, and the surfels that it claims.
/// @param instance  [surfels, 32].  @param position_m  [surfels, 3].
/// @param score  A surfel is claimed with an A above this.
[[nodiscard]] std::vector<QueryUse> query_uses(const QuerySet& queries, const Tensor& instance,
                                               const Tensor& position_m, double score);

}  // namespace segsim::reconstruction::internal
