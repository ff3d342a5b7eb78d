#include "reconstruction/labels/internal/label_losses.h"

namespace segsim::reconstruction::internal {

Tensor negative_log_likelihood(const Tensor& probability, const Tensor& weight) {
  return -(torch::log(probability + kLogFloor) * weight).mean();
}

Tensor dice_losses(const Tensor& mask, const Tensor& target, const Tensor& importance) {
  const Tensor counted = target * importance.unsqueeze(1);
  const Tensor both = (mask * counted).sum(0);
  const Tensor sizes = (mask * importance.unsqueeze(1)).sum(0) + counted.sum(0);
  return 1.0 - (2.0 * both + kDiceSmooth) / (sizes + kDiceSmooth);
}

Tensor bce_losses(const Tensor& mask, const Tensor& target, const Tensor& weight) {
  const Tensor m = mask.clamp(kLogFloor, 1.0 - kLogFloor);
  const Tensor each = target * torch::log(m) + (1.0 - target) * torch::log1p(-m);
  return -(each * weight.unsqueeze(1)).mean(0);
}

MaskCosts mask_costs(const Tensor& mask, const Tensor& target, const Tensor& importance,
                     const Tensor& weight) {
  const at::NoGradGuard no_grad;
  const auto pixels = static_cast<double>(mask.size(0));
  const Tensor counted = mask * importance.unsqueeze(1);
  const Tensor both = counted.t().matmul(target);
  const Tensor sizes = counted.sum(0).unsqueeze(1) + importance.unsqueeze(0).matmul(target);
  const Tensor m = mask.clamp(kLogFloor, 1.0 - kLogFloor);
  const Tensor log_out = torch::log1p(-m).mul_(weight.unsqueeze(1));
  const Tensor log_in = torch::log(m).mul_(weight.unsqueeze(1));
  // sum c (t log M + (1 - t) log(1 - M)) = sum c log(1 - M) + t . c (log M - log(1 - M)).
  const Tensor bce = log_out.sum(0).unsqueeze(1) + (log_in - log_out).t().matmul(target);
  return {1.0 - (2.0 * both + kDiceSmooth) / (sizes + kDiceSmooth), bce / -pixels};
}

Tensor class_cross_entropy(const Tensor& logits, const Tensor& target, const Tensor& weight) {
  const Tensor each = -torch::log_softmax(logits, 1).gather(1, target.unsqueeze(1)).squeeze(1);
  return (each * weight).sum() / weight.sum().clamp_min(1e-12);
}

Tensor repulsion_loss(const Tensor& embedding, double margin) {
  const std::int64_t n = embedding.size(0);
  if (n < 2) return embedding.sum() * 0.0;
  const Tensor difference = embedding.unsqueeze(0) - embedding.unsqueeze(1);
  // The floor keeps the derivative of the root finite for equal embeddings.
  const Tensor distance = (difference.pow(2).sum(2) + 1e-12).sqrt();
  const Tensor close = (margin - distance).clamp_min(0.0);
  const Tensor others = 1.0 - torch::eye(n, embedding.options());
  return (close * others).sum() / static_cast<double>(n * (n - 1));
}

Tensor symmetric_kl(const Tensor& a, const Tensor& b) {
  const Tensor logs = torch::log(a + kLogFloor) - torch::log(b + kLogFloor);
  return 0.5 * ((a - b) * logs).sum(1).mean();
}

}  // namespace segsim::reconstruction::internal
