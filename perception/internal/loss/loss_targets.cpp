#include "perception/internal/loss/loss_targets.h"

#include <torch/torch.h>

#include <span>

namespace segsim::perception {
namespace {

std::span<const float> span_of(const torch::Tensor& tensor, int64_t offset, int64_t size) {
  return {tensor.data_ptr<float>() + offset, static_cast<std::size_t>(size)};
}

}  // namespace

LossTargets targets_on_host(const torch::Tensor& scores, const torch::Tensor& boxes,
                            const Anchors& anchors,
                            const std::vector<std::vector<LabeledBox>>& truth,
                            const AssignerRule& rule) {
  const auto dense_scores = scores.contiguous(), dense_boxes = boxes.contiguous();
  const auto centres = anchors.centre_px.contiguous();
  const int64_t batch = scores.size(0), count = scores.size(1), classes = scores.size(2);
  LossTargets targets;
  targets.score = torch::zeros({batch, count, classes}, torch::kFloat32);
  targets.class_weight = torch::ones({batch, count, classes}, torch::kFloat32);
  std::vector<int64_t> rows, anchor_of_row;
  std::vector<float> box, weight;
  for (int64_t image = 0; image < batch; ++image) {
    const auto& objects = truth[static_cast<std::size_t>(image)];
    const Assignment assigned =
        assign_anchors({static_cast<int>(classes), span_of(centres, 0, count * 2),
                        span_of(dense_scores, image * count * classes, count * classes),
                        span_of(dense_boxes, image * count * 4, count * 4), objects},
                       rule);
    float* weight_out = targets.class_weight.data_ptr<float>() + image * count * classes;
    for (std::size_t i = 0; i < assigned.class_weight.size(); ++i) {
      weight_out[i] = static_cast<float>(assigned.class_weight[i]);
    }
    for (int64_t a = 0; a < count; ++a) {
      const int object = assigned.box_of_anchor[static_cast<std::size_t>(a)];
      if (object < 0) continue;
      const LabeledBox& label = objects[static_cast<std::size_t>(object)];
      const float target = assigned.target_score[static_cast<std::size_t>(a)];
      targets.score.data_ptr<float>()[(image * count + a) * classes + label.class_index] =
          target;
      rows.push_back(image * count + a);
      anchor_of_row.push_back(a);
      box.insert(box.end(), {label.box.x0, label.box.y0, label.box.x1, label.box.y1});
      weight.push_back(target);
      targets.score_sum += target;
    }
  }
  targets.row = torch::tensor(rows, torch::kInt64);
  targets.anchor = torch::tensor(anchor_of_row, torch::kInt64);
  targets.box = torch::tensor(box, torch::kFloat32).view({-1, 4});
  targets.weight = torch::tensor(weight, torch::kFloat32);
  return targets;
}

}  // namespace segsim::perception
