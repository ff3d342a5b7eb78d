#pragma once

/// @file
/// From features to labels: the paper's distance-aware attention with derivatives, the same
/// maths as fold_panoptic_model() (renderer/scene/panoptic_field.h).
///
///     S = sigmoid(f_q . f_ins),  D = exp(-d^2 / 2),  A = S D,  l = labels of A by variant

#include "reconstruction/internal/tensors/tensors.h"
#include "renderer/scene/panoptic_field.h"

namespace segsim::reconstruction::internal {

/// Squared Mahalanobis distances. Computed as a quadratic form of the position, so that one
/// matrix product serves all pairs; positions are taken relative to their mean, which keeps
/// the rounding of d^2 below 0.01 in a scene of 10 m with sigma = 5 cm.
/// @param position_m  [surfels, 3].  @param query_m  [queries, 3].
/// @param log_sigma  [queries, 3].  @param rotation  [queries, 4], w x y z, of any length > 0.
/// @return  [surfels, queries], >= 0.
[[nodiscard]] Tensor squared_distances(const Tensor& position_m, const Tensor& query_m,
                                       const Tensor& log_sigma, const Tensor& rotation);

struct LabelSettings {
  renderer::LabelVariant variant = renderer::LabelVariant::kNormalised;
  double none_score = 0.05, temperature = 0.1;
};

/// @param logit  [surfels, queries], f_q . f_ins.  @param distance2  The same shape.
/// @return  [surfels, queries]; the none-score has no column.
[[nodiscard]] Tensor query_labels(const Tensor& logit, const Tensor& distance2,
                                  const LabelSettings& settings);

/// The same from separate operations: for devices other than the CPU, and the oracle of the
/// fused one.
[[nodiscard]] Tensor query_labels_unfused(const Tensor& logit, const Tensor& distance2,
                                          const LabelSettings& settings);

}  // namespace segsim::reconstruction::internal
