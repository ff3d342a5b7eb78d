#include "reconstruction/labels/internal/query_matching.h"

#include "reconstruction/labels/assignment.h"
#include "reconstruction/labels/internal/label_losses.h"

namespace segsim::reconstruction::internal {
namespace {

/// [masks, queries], double, on the host.
Tensor pair_costs(const MaskCosts& costs, const Tensor& class_logits,
                  const BatchTargets& targets, const ClassSplit& classes, double class_cost) {
  std::vector<std::int64_t> thing_of_mask;
  for (const TargetMask& mask : targets.masks) {
    thing_of_mask.push_back(classes.thing_index[static_cast<std::size_t>(mask.class_index)]);
  }
  const Tensor certainty =
      torch::softmax(class_logits, 1)
          .index_select(1, device_tensor(thing_of_mask, torch::kInt64, class_logits.device()));
  return (costs.dice + costs.bce - class_cost * certainty)
      .t()
      .to(torch::kFloat64)
      .cpu()
      .contiguous();
}

}  // namespace

Matching match_queries(const Tensor& mask, const Tensor& class_logits,
                       const BatchTargets& targets, const MaskTargets& masks,
                       const ClassSplit& classes, const QueryConfig& config, bool gated) {
  const at::NoGradGuard no_grad;
  Matching matching;
  matching.query_of.assign(targets.masks.size(), -1);
  const auto seen =
      static_cast<float>(config.visible_share * static_cast<double>(mask.size(0)));
  const Tensor mass = mask.sum(0).cpu();
  const auto count = static_cast<std::size_t>(mask.size(1));
  for (std::size_t q = 0; q < count; ++q) {
    matching.visible.push_back(mass.data_ptr<float>()[q] >= seen);
  }
  if (targets.masks.empty() || count == 0) return matching;

  const MaskCosts costs = mask_costs(mask, masks.one_hot, masks.importance, masks.weight);
  const Tensor cost = pair_costs(costs, class_logits, targets, classes, config.class_cost);
  const std::vector<int> query_of =
      assign({cost.data_ptr<double>(), static_cast<std::size_t>(cost.numel())},
             targets.masks.size(), count);
  const Tensor dice = costs.dice.t().cpu().contiguous();
  for (std::size_t m = 0; m < query_of.size(); ++m) {
    if (query_of[m] == kUnassigned) continue;
    const std::size_t pair = m * count + static_cast<std::size_t>(query_of[m]);
    if (gated && static_cast<double>(dice.data_ptr<float>()[pair]) > config.max_dice) continue;
    matching.query_of[m] = query_of[m];
    matching.queries.push_back(query_of[m]);
    matching.masks.push_back(static_cast<std::int64_t>(m));
  }
  return matching;
}

}  // namespace segsim::reconstruction::internal
