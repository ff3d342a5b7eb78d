#pragma once

/// @file
/// Losses of labels rendered at sampled pixels (paper, "Loss Function Details"; what the paper
/// leaves open follows PanopticRecon++ with its double softmaxes and logits of probabilities
/// taken out). All accept float and double and give scalars, unless a shape is written.

#include "reconstruction/internal/tensors/tensors.h"

namespace segsim::reconstruction::internal {

inline constexpr double kLogFloor = 1e-6;    ///< Of probabilities in logarithms.
inline constexpr double kDiceSmooth = 1e-6;  ///< Of numerator and denominator.

/// mean_p w_p (-log(P_p + 1e-6)).
/// @param probability  [pixels], of the target.  @param weight  [pixels].
[[nodiscard]] Tensor negative_log_likelihood(const Tensor& probability, const Tensor& weight);

/// 1 - (2 sum v M t + s) / (sum v M + sum v t + s) of each mask.
/// @param mask  [pixels, masks], in [0, 1].  @param target  The same shape, 0 or 1.
/// @param importance  [pixels], v.
/// @return  [masks].
[[nodiscard]] Tensor dice_losses(const Tensor& mask, const Tensor& target,
                                 const Tensor& importance);

/// mean_p w_p (-t log M - (1 - t) log(1 - M)) of each mask, M clamped to [1e-6, 1 - 1e-6].
/// @return  [masks].
[[nodiscard]] Tensor bce_losses(const Tensor& mask, const Tensor& target,
                                const Tensor& weight);

/// Dice and BCE of every mask with every target, without derivatives.
/// @param mask  [pixels, queries].  @param target  [pixels, instances].
struct MaskCosts {
  Tensor dice, bce;  ///< [queries, instances].
};
[[nodiscard]] MaskCosts mask_costs(const Tensor& mask, const Tensor& target,
                                   const Tensor& importance, const Tensor& weight);

/// sum_i w_i (-log softmax(logits_i)[target_i]) / sum_i w_i; 0 without weight.
/// @param logits  [rows, classes].  @param target  [rows] int64.  @param weight  [rows].
[[nodiscard]] Tensor class_cross_entropy(const Tensor& logits, const Tensor& target,
                                         const Tensor& weight);

/// Mean over ordered pairs i != j of max(0, margin - |e_i - e_j|); 0 for fewer than two.
/// @param embedding  [queries, features].
[[nodiscard]] Tensor repulsion_loss(const Tensor& embedding, double margin);

/// mean_p sum_c (P - Q) (log P - log Q) / 2, with logarithms of value + 1e-6.
/// @param a, b  [pixels, channels], both with derivatives.
[[nodiscard]] Tensor symmetric_kl(const Tensor& a, const Tensor& b);

}  // namespace segsim::reconstruction::internal
