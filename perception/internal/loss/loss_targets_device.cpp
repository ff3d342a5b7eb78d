#include "perception/internal/loss/loss_targets.h"

#include <torch/torch.h>

#include <utility>

#include "perception/internal/loss/detection_loss.h"

namespace segsim::perception {
namespace {

/// The labelled boxes of all images, one after the other, on the device.
struct Labels {
  torch::Tensor box;                 ///< [labels, 4] pixels
  torch::Tensor image, class_index;  ///< [labels]
  torch::Tensor scored;              ///< [labels] bool
};

/// A label with an anchor whose centre lies in it; ordered by label, then anchor.
struct Pairs {
  torch::Tensor label, anchor;       ///< [pairs]
  torch::Tensor row;                 ///< [pairs], index into batch * anchors
  torch::Tensor overlap, alignment;  ///< [pairs] double, as assigner.cpp judges them

  [[nodiscard]] Pairs select(const torch::Tensor& index) const {
    const auto of = [&index](const torch::Tensor& all) { return all.index_select(0, index); };
    return {of(label), of(anchor), of(row), of(overlap), of(alignment)};
  }
};

Labels upload(const std::vector<std::vector<LabeledBox>>& truth, const torch::Device& device) {
  std::vector<float> numbers;  // In one piece; image and class are exact in float.
  for (std::size_t image = 0; image < truth.size(); ++image) {
    for (const LabeledBox& label : truth[image]) {
      numbers.insert(
          numbers.end(),
          {label.box.x0, label.box.y0, label.box.x1, label.box.y1, static_cast<float>(image),
           static_cast<float>(label.class_index), label.not_scored() ? 0.0F : 1.0F});
    }
  }
  const auto table = torch::tensor(numbers, torch::kFloat32).view({-1, 7}).to(device);
  return {table.narrow(1, 0, 4), table.select(1, 4).to(torch::kInt64),
          table.select(1, 5).to(torch::kInt64), table.select(1, 6) > 0.5};
}

/// Indices of both for each true entry of [labels, anchors].
std::pair<torch::Tensor, torch::Tensor> inside(const torch::Tensor& wanted,
                                               const torch::Tensor& box,
                                               const Anchors& anchors) {
  const auto centre = anchors.centre_px.t().unsqueeze(1);  // [2, 1, anchors]
  const auto low = box.t().unsqueeze(2);                   // [4, labels, 1]
  const auto hits = ((centre[0] > low[0]) & (centre[0] < low[2]) & (centre[1] > low[1]) &
                     (centre[1] < low[3]) & wanted.unsqueeze(1))
                        .nonzero();
  return {hits.select(1, 0), hits.select(1, 1)};
}

Pairs judge_pairs(const Labels& labels, const torch::Tensor& scores,
                  const torch::Tensor& boxes, const Anchors& anchors) {
  const int64_t count = scores.size(1), classes = scores.size(2);
  const auto [label, anchor] = inside(labels.scored, labels.box, anchors);
  Pairs pairs{label, anchor, labels.image.index_select(0, label) * count + anchor, {}, {}};
  const auto predicted = boxes.reshape({-1, 4}).index_select(0, pairs.row);
  const auto score =
      scores.reshape({-1})
          .index_select(0, pairs.row * classes + labels.class_index.index_select(0, label))
          .to(torch::kFloat64);
  pairs.overlap = ciou_rows(predicted.to(torch::kFloat64),
                            labels.box.index_select(0, label).to(torch::kFloat64))
                      .clamp_min(0.0);
  pairs.alignment = (score.clamp_min(0.0).sqrt() * pairs.overlap.pow(6)).nan_to_num(0.0);
  return pairs;
}

/// Orders by `group`, inside it by descending `value`, equal ones as they are now.
torch::Tensor order_in_groups(const torch::Tensor& group, const torch::Tensor& value) {
  const auto by_value =
      std::get<1>(value.sort(/*stable=*/true, /*dim=*/0, /*descending=*/true));
  const auto by_group =
      std::get<1>(group.index_select(0, by_value).sort(/*stable=*/true, 0, false));
  return by_value.index_select(0, by_group);
}

/// Whether a pair is one of the best of its label.
torch::Tensor taken_by_labels(const Pairs& pairs, int64_t labels) {
  const auto order = order_in_groups(pairs.label, pairs.alignment);
  const auto sorted = pairs.label.index_select(0, order);
  const auto counts =
      torch::zeros({labels}, sorted.options()).index_add(0, sorted, torch::ones_like(sorted));
  const auto first = counts.cumsum(0) - counts;
  const auto rank =
      torch::arange(sorted.size(0), sorted.options()) - first.index_select(0, sorted);
  auto best = torch::zeros_like(pairs.label, torch::kBool);
  best.index_put_({order}, rank < kCandidatesPerBox);
  return best & (pairs.alignment > 0.0);
}

/// The one pair of each anchor that was taken, by ascending rows.
Pairs owners(const Pairs& pairs, const torch::Tensor& taken, int64_t rows,
             const AssignerRule& rule) {
  auto contends = taken;
  if (rule.all_boxes_contest) {
    auto takers = torch::zeros({rows}, pairs.row.options());
    takers.index_add_(0, pairs.row, taken.to(torch::kInt64));
    contends = taken | (takers.index_select(0, pairs.row) >= 2);
  }
  const Pairs all = pairs.select(contends.nonzero().select(1, 0));
  const Pairs sorted = all.select(order_in_groups(all.row, all.overlap));
  const int64_t count = sorted.row.size(0);
  auto first = torch::ones({count}, sorted.row.options().dtype(torch::kBool));
  if (count > 1) {
    first.narrow(0, 1, count - 1)
        .copy_(sorted.row.narrow(0, 1, count - 1) != sorted.row.narrow(0, 0, count - 1));
  }
  return sorted.select(first.nonzero().select(1, 0));
}

/// Of each owned anchor, for the class of its label.
torch::Tensor target_scores(const Pairs& owned, int64_t labels, const AssignerRule& rule) {
  if (owned.label.numel() == 0) return torch::zeros_like(owned.overlap, torch::kFloat32);
  const auto every_label = torch::arange(labels, owned.label.options()).unsqueeze(1);
  const auto of_label = owned.label == every_label;  // [labels, owned]
  const auto best_of_label = [&](const torch::Tensor& value) {
    return (of_label * value).amax(1).index_select(0, owned.label);
  };
  const auto alignment = best_of_label(owned.alignment);
  const auto score =
      owned.alignment / (alignment + rule.alignment_eps) * best_of_label(owned.overlap);
  return torch::where(alignment > 0.0, score, torch::zeros_like(score)).to(torch::kFloat32);
}

}  // namespace

LossTargets targets_on_device(const torch::Tensor& scores, const torch::Tensor& boxes,
                              const Anchors& anchors,
                              const std::vector<std::vector<LabeledBox>>& truth,
                              const AssignerRule& rule) {
  const int64_t batch = scores.size(0), count = scores.size(1), classes = scores.size(2);
  const int64_t rows = batch * count;
  const Labels labels = upload(truth, scores.device());
  const int64_t label_count = labels.box.size(0);
  LossTargets targets;
  targets.score = torch::zeros({batch, count, classes}, scores.options());
  targets.class_weight = torch::ones({batch, count, classes}, scores.options());

  const Pairs pairs = judge_pairs(labels, scores, boxes, anchors);
  const Pairs owned = owners(pairs, taken_by_labels(pairs, label_count), rows, rule);
  targets.row = owned.row;
  targets.anchor = owned.anchor;
  targets.box = labels.box.index_select(0, owned.label);
  targets.weight = target_scores(owned, label_count, rule);
  targets.score_sum = targets.weight.to(torch::kFloat64).sum().item<double>();
  const auto owned_class = labels.class_index.index_select(0, owned.label);
  targets.score.view({-1}).index_put_({owned.row * classes + owned_class}, targets.weight);

  // Anchors in an ignored box are not judged for its class, unless they own one of that class.
  auto class_of_row = torch::full({rows}, -1, labels.image.options());
  class_of_row.index_put_({owned.row}, owned_class);
  const auto [label, anchor] = inside(~labels.scored, labels.box, anchors);
  const auto row = labels.image.index_select(0, label) * count + anchor;
  const auto ignored_class = labels.class_index.index_select(0, label);
  const auto other =
      (class_of_row.index_select(0, row) != ignored_class).nonzero().select(1, 0);
  targets.class_weight.view({-1}).index_fill_(
      0, (row * classes + ignored_class).index_select(0, other), 0.0);
  return targets;
}

}  // namespace segsim::perception
