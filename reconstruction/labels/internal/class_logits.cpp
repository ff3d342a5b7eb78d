#include "reconstruction/labels/internal/class_logits.h"

#include <algorithm>

#include "reconstruction/labels/internal/label_losses.h"

namespace segsim::reconstruction::internal {
namespace {

using Entry = renderer::SparseScores::Entry;

/// Mean over pixels of the weight times -log of the target's probability, where rows of
/// `probability` are renormalised over the classes.
Tensor cross_entropy(const Tensor& probability, const Tensor& target, const Tensor& weight) {
  const Tensor normalised = probability / probability.sum(1, true).clamp_min(1e-6);
  return negative_log_likelihood(normalised.gather(1, target.unsqueeze(1)).squeeze(1), weight);
}

/// The values above `base`, over `range`; largest first.
std::vector<Entry> entries_above(const float* value, std::int64_t count, float base,
                                 float range) {
  std::vector<Entry> row;
  for (std::int64_t j = 0; j < count; ++j) {
    if (value[j] <= base) continue;
    row.push_back({static_cast<std::uint16_t>(j), (value[j] - base) / range});
  }
  std::stable_sort(row.begin(), row.end(),
                   [](const Entry& a, const Entry& b) { return a.excess > b.excess; });
  return row;
}

}  // namespace

ClassLogits::ClassLogits(std::int64_t surfels, std::int64_t classes, const at::Device& device)
    : logits_(torch::zeros({surfels, classes},
                           torch::TensorOptions().dtype(torch::kFloat32).device(device))) {}

ClassLogits::Rendered ClassLogits::render(const BlendMatrix& matrix,
                                          const MaskTargets& masks) const {
  Rendered r;
  r.rows = logits_.value().index_select(0, matrix.surfel).detach().requires_grad_(true);
  r.probability = blend(matrix, torch::softmax(r.rows, 1)).index_select(0, masks.pixels);
  return r;
}

void ClassLogits::add_class_loss(LossSum& sum, double factor, const Rendered& rendered,
                                 const BatchTargets& targets, const MaskTargets& masks) const {
  const Tensor label =
      device_tensor(targets.class_index, torch::kInt64, rendered.rows.device())
          .index_select(0, masks.pixels);
  sum.add("semantic", factor, cross_entropy(rendered.probability, label, masks.weight));
}

void ClassLogits::add_segment_loss(LossSum& sum, double factor, const Rendered& rendered,
                                   const MaskTargets& masks) const {
  if (masks.one_hot.size(1) == 0) return;
  const Tensor target = masks.one_hot.t().matmul(rendered.probability.detach()).argmax(1);
  const Tensor inside = masks.one_hot.sum(1).gt(0.5).nonzero().squeeze(1);
  const Tensor mask_of = masks.one_hot.index_select(0, inside).argmax(1);
  sum.add(
      "segment", factor,
      cross_entropy(rendered.probability.index_select(0, inside),
                    target.index_select(0, mask_of), masks.weight.index_select(0, inside)));
}

void ClassLogits::step(const BlendMatrix& matrix, const Rendered& rendered, double rate) {
  if (rendered.rows.grad().defined()) {
    logits_.step_rows(matrix.surfel, rendered.rows.grad(), rate);
  }
}

Tensor ClassLogits::probabilities() const { return torch::softmax(logits_.value(), 1); }

void ClassLogits::load(const StateReader& in) {
  in.expect_rows("surfel.semantic", logits_.value().size(0));
  logits_.load(in, "surfel.semantic");
}

renderer::PanopticField field_of_classes(const std::vector<core::SceneClass>& classes,
                                         const Tensor& probability) {
  renderer::PanopticField field;
  for (const core::SceneClass& c : classes) {
    field.class_id.push_back(c.id);
    field.class_is_thing.push_back(c.thing ? 1 : 0);
  }
  field.classes = scores_of_probabilities(probability);
  return field;
}

renderer::SparseScores scores_of_probabilities(const Tensor& probability) {
  const Tensor host = probability.detach().cpu().contiguous();
  const std::int64_t count = host.size(1);
  renderer::SparseScores scores(static_cast<std::size_t>(host.size(0)),
                                static_cast<std::size_t>(count));
  for (std::int64_t s = 0; s < host.size(0); ++s) {
    scores.set(static_cast<std::size_t>(s), 0.0F,
               entries_above(host.data_ptr<float>() + s * count, count, 0.0F, 1.0F));
  }
  return scores;
}

renderer::SparseScores scores_of_logits(const Tensor& logits) {
  const Tensor host = logits.detach().cpu().contiguous();
  const std::int64_t count = host.size(1);
  renderer::SparseScores scores(static_cast<std::size_t>(host.size(0)),
                                static_cast<std::size_t>(count));
  if (count == 1) return scores_of_probabilities(torch::ones_like(host));
  if (host.numel() == 0) return scores;
  const float lowest = host.min().item<float>();
  const float range = std::max(host.max().item<float>() - lowest, 1e-6F);
  for (std::int64_t s = 0; s < host.size(0); ++s) {
    const float* value = host.data_ptr<float>() + s * count;
    const float base = *std::min_element(value, value + count);
    scores.set(static_cast<std::size_t>(s), (base - lowest) / range,
               entries_above(value, count, base, range));
  }
  return scores;
}

}  // namespace segsim::reconstruction::internal
