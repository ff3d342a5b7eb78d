#include "reconstruction/labels/internal/query_losses.h"

#include "reconstruction/labels/internal/label_losses.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr std::int64_t kPruningSurfels = 100'000;  ///< Sampled for the overlap of queries.

}  // namespace

Tensor add_semantic_loss(LossSum& sum, double factor, const BlendMatrix& matrix,
                         const Tensor& classes, const BatchTargets& targets) {
  const at::Device device = classes.device();
  Tensor at = blend_channel(matrix, classes,
                            padded_indices(targets.class_index, matrix.pixels, device));
  const Tensor labelled = device_tensor(targets.labelled, torch::kInt64, device);
  const Tensor weight = device_tensor(targets.weight, torch::kFloat32, device);
  sum.add(
      "semantic", factor,
      negative_log_likelihood(at.index_select(0, labelled), weight.index_select(0, labelled)));
  return at;
}

void add_instance_losses(LossSum& sum, const Tensor& blended, const Matching& matching,
                         const MaskTargets& masks, const InstanceFactors& factors) {
  if (matching.queries.empty()) return;
  const at::Device device = blended.device();
  const Tensor mask =
      blended.index_select(1, device_tensor(matching.queries, torch::kInt64, device))
          .index_select(0, masks.pixels);
  const Tensor target =
      masks.one_hot.index_select(1, device_tensor(matching.masks, torch::kInt64, device));
  sum.add("dice", factors.dice, dice_losses(mask, target, masks.importance).mean());
  sum.add("bce", factors.bce, bce_losses(mask, target, masks.weight).mean());
}

std::vector<std::int64_t> without_unmatched(const std::vector<std::int64_t>& pixels,
                                            const BatchTargets& targets,
                                            const Matching& matching) {
  std::vector<std::int64_t> kept;
  for (const std::int64_t pixel : pixels) {
    const std::int64_t mask = targets.mask_index[static_cast<std::size_t>(pixel)];
    if (mask < 0 || matching.query_of[static_cast<std::size_t>(mask)] >= 0)
      kept.push_back(pixel);
  }
  return kept;
}

Tensor query_class_loss(const Tensor& class_logits, const BatchTargets& targets,
                        const Matching& matching, const ClassSplit& classes,
                        double no_object) {
  const auto nothing = static_cast<std::int64_t>(classes.things.size());
  std::vector<std::int64_t> target(matching.visible.size(), nothing);
  std::vector<float> weight(matching.visible.size(), 0.0F);
  for (std::size_t q = 0; q < weight.size(); ++q) {
    if (matching.visible[q]) weight[q] = static_cast<float>(no_object);
  }
  for (std::size_t i = 0; i < matching.queries.size(); ++i) {
    const TargetMask& mask = targets.masks[static_cast<std::size_t>(matching.masks[i])];
    const auto q = static_cast<std::size_t>(matching.queries[i]);
    target[q] = classes.thing_index[static_cast<std::size_t>(mask.class_index)];
    weight[q] = 1.0F;
  }
  const at::Device device = class_logits.device();
  return class_cross_entropy(class_logits, device_tensor(target, torch::kInt64, device),
                             device_tensor(weight, torch::kFloat32, device));
}

Tensor stuff_rows(const Tensor& classes, const ClassSplit& split) {
  return classes.index_select(1, device_tensor(split.stuff, torch::kInt64, classes.device()));
}

Tensor panoptic_loss(const BlendMatrix& matrix, const PanopticRows& rows,
                     const Tensor& class_probability, const BatchTargets& targets,
                     const Matching& matching, const ClassSplit& classes) {
  std::vector<std::int64_t> query(targets.class_index.size(), -1), used;
  std::vector<float> is_stuff;
  for (const std::int64_t pixel : targets.labelled) {
    const auto p = static_cast<std::size_t>(pixel);
    const std::int64_t mask = targets.mask_index[p];
    const bool stuff =
        classes.stuff_index[static_cast<std::size_t>(targets.class_index[p])] >= 0;
    if (mask >= 0) query[p] = matching.query_of[static_cast<std::size_t>(mask)];
    if (!stuff && query[p] < 0) continue;
    used.push_back(pixel);
    is_stuff.push_back(stuff ? 1.0F : 0.0F);
  }
  if (used.empty()) return {};
  const at::Device device = rows.classes.device();
  const Tensor of_query =
      blend_channel(matrix, rows.shares, padded_indices(query, matrix.pixels, device),
                    1.0 - stuff_rows(rows.classes, classes).sum(1));
  const Tensor pixels = device_tensor(used, torch::kInt64, device);
  const Tensor stuff = device_tensor(is_stuff, torch::kFloat32, device);
  const Tensor weight = device_tensor(targets.weight, torch::kFloat32, device);
  return negative_log_likelihood(
      class_probability.index_select(0, pixels) * stuff + of_query.index_select(0, pixels),
      weight.index_select(0, pixels));
}

std::vector<QueryUse> query_uses(const QuerySet& queries, const Tensor& instance,
                                 const Tensor& position_m, double score) {
  const at::NoGradGuard no_grad;
  std::vector<QueryUse> uses(static_cast<std::size_t>(queries.size()));
  const std::int64_t stride = 1 + position_m.size(0) / kPruningSurfels;
  const Tensor rows =
      torch::arange(0, position_m.size(0), stride, position_m.options().dtype(torch::kInt64));
  const QuerySet::Leaves leaves = queries.leaves();
  const Tensor logit = instance.index_select(0, rows).matmul(
      QuerySet::embedding(leaves, QuerySet::projected(leaves)).t());
  const Tensor distance2 = squared_distances(
      position_m.index_select(0, rows), leaves.position_m, leaves.log_sigma, leaves.rotation);
  const Tensor attention =
      query_labels(logit, distance2, {renderer::LabelVariant::kRaw, 0.0, 1.0})
          .t()
          .cpu()
          .contiguous();
  const auto* a = attention.data_ptr<float>();
  for (std::size_t q = 0; q < uses.size(); ++q) {
    const auto query = static_cast<std::int64_t>(q);
    uses[q].matches = queries.matches(query);
    uses[q].recent_matches = queries.recent_matches(query);
    uses[q].frames = static_cast<std::int64_t>(queries.frames(query));
    for (std::int64_t s = 0; s < rows.size(0); ++s) {
      if (static_cast<double>(a[query * rows.size(0) + s]) > score) {
        uses[q].surfels.push_back(s);
      }
    }
  }
  return uses;
}

}  // namespace segsim::reconstruction::internal
