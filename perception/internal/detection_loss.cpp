#include "perception/internal/detection_loss.h"

#include <numbers>

#include "perception/internal/ciou.h"

namespace segsim::perception {
namespace {

/// Targets of a batch: dense for classes, one row per positive anchor for boxes.
struct Targets {
  torch::Tensor score, class_weight;  ///< [batch, anchors, classes]
  torch::Tensor row;                  ///< [positives], index into batch * anchors
  torch::Tensor anchor;               ///< [positives], index into anchors
  torch::Tensor box;                  ///< [positives, 4] pixels
  torch::Tensor weight;               ///< [positives] target score
  double score_sum = 0.0;
};

Targets make_targets(const RawOutput& output, const Anchors& anchors,
                     const std::vector<std::vector<LabeledBox>>& truth,
                     const AssignerRule& rule) {
  torch::NoGradGuard no_grad;
  const auto scores = output.classes.sigmoid().to(torch::kCPU).contiguous();
  const auto boxes = decode_boxes(output.box, anchors).to(torch::kCPU).contiguous();
  const auto centres = anchors.centre_px.to(torch::kCPU).contiguous();
  const int64_t batch = scores.size(0), count = scores.size(1), classes = scores.size(2);
  auto score = torch::zeros({batch, count, classes}, torch::kFloat32);
  auto class_weight = torch::ones({batch, count, classes}, torch::kFloat32);
  std::vector<int64_t> rows, anchor_of_row;
  std::vector<float> box, weight;
  Targets targets;
  const auto span_of = [](const torch::Tensor& tensor, int64_t offset, int64_t size) {
    return std::span<const float>(tensor.data_ptr<float>() + offset,
                                  static_cast<std::size_t>(size));
  };
  for (int64_t image = 0; image < batch; ++image) {
    const auto& objects = truth[static_cast<std::size_t>(image)];
    const Assignment assigned =
        assign_anchors({static_cast<int>(classes), span_of(centres, 0, count * 2),
                        span_of(scores, image * count * classes, count * classes),
                        span_of(boxes, image * count * 4, count * 4), objects},
                       rule);
    float* weight_out = class_weight.data_ptr<float>() + image * count * classes;
    for (std::size_t i = 0; i < assigned.class_weight.size(); ++i) {
      weight_out[i] = static_cast<float>(assigned.class_weight[i]);
    }
    for (int64_t a = 0; a < count; ++a) {
      const int object = assigned.box_of_anchor[static_cast<std::size_t>(a)];
      if (object < 0) continue;
      const LabeledBox& label = objects[static_cast<std::size_t>(object)];
      const float target = assigned.target_score[static_cast<std::size_t>(a)];
      score.data_ptr<float>()[(image * count + a) * classes + label.class_index] = target;
      rows.push_back(image * count + a);
      anchor_of_row.push_back(a);
      box.insert(box.end(), {label.box.x0, label.box.y0, label.box.x1, label.box.y1});
      weight.push_back(target);
      targets.score_sum += target;
    }
  }
  const auto device = output.box.device();
  targets.score = score.to(device);
  targets.class_weight = class_weight.to(device);
  targets.row = torch::tensor(rows, torch::kInt64).to(device);
  targets.anchor = torch::tensor(anchor_of_row, torch::kInt64).to(device);
  targets.box = torch::tensor(box, torch::kFloat32).view({-1, 4}).to(device);
  targets.weight = torch::tensor(weight, torch::kFloat32).to(device);
  return targets;
}

}  // namespace

torch::Tensor ciou_rows(const torch::Tensor& a, const torch::Tensor& b) {
  const auto ca = a.unbind(1), cb = b.unbind(1);
  const auto wa = ca[2] - ca[0], ha = ca[3] - ca[1] + kCiouEps;
  const auto wb = cb[2] - cb[0], hb = cb[3] - cb[1] + kCiouEps;
  const auto wi = (torch::minimum(ca[2], cb[2]) - torch::maximum(ca[0], cb[0])).clamp_min(0);
  const auto hi = (torch::minimum(ca[3], cb[3]) - torch::maximum(ca[1], cb[1])).clamp_min(0);
  const auto overlap = wi * hi / (wa * ha + wb * hb - wi * hi + kCiouEps);
  const auto wc = torch::maximum(ca[2], cb[2]) - torch::minimum(ca[0], cb[0]);
  const auto hc = torch::maximum(ca[3], cb[3]) - torch::minimum(ca[1], cb[1]);
  const auto dx = (cb[0] + cb[2] - ca[0] - ca[2]) / 2,
             dy = (cb[1] + cb[3] - ca[1] - ca[3]) / 2;
  const auto distance = (dx * dx + dy * dy) / (wc * wc + hc * hc + kCiouEps);
  const auto angle = torch::atan(wb / hb) - torch::atan(wa / ha);
  const auto v = 4.0 / (std::numbers::pi * std::numbers::pi) * angle * angle;
  const auto alpha = (v / (v - overlap + (1.0 + kCiouEps))).detach();
  return overlap - distance - alpha * v;
}

torch::Tensor bin_loss_rows(const torch::Tensor& logits, const torch::Tensor& distances) {
  const auto target = distances.clamp_min(0).clamp_max(kRegBins - 1 - 0.01).unsqueeze(-1);
  const auto lower = target.floor();
  const auto share_upper = target - lower;
  const auto index = lower.to(torch::kInt64);
  const auto log_p = logits.view({-1, 4, kRegBins}).log_softmax(-1);
  const auto loss = -(log_p.gather(-1, index) * (1 - share_upper) +
                      log_p.gather(-1, index + 1) * share_upper);
  return loss.squeeze(-1).mean(-1);
}

LossParts detection_loss(const RawOutput& output, const Anchors& anchors,
                         const std::vector<std::vector<LabeledBox>>& truth,
                         const AssignerRule& rule) {
  const Targets targets = make_targets(output, anchors, truth, rule);
  const double divisor = std::max(targets.score_sum, 1.0);

  // max(x, 0) - x y + log(1 + e^-|x|), summed over the entries that are judged.
  const auto& x = output.classes;
  const auto cross_entropy =
      x.clamp_min(0) - x * targets.score + torch::log1p(torch::exp(-x.abs()));
  LossParts parts;
  parts.classes = (cross_entropy * targets.class_weight).sum() / divisor;
  if (targets.row.numel() == 0) {
    parts.box = parts.bins = output.box.sum() * 0.0;  // Keeps the graph whole.
    return parts;
  }

  const auto logits = output.box.reshape({-1, 4 * kRegBins}).index_select(0, targets.row);
  const Anchors own{anchors.centre_px.index_select(0, targets.anchor),
                    anchors.stride_px.index_select(0, targets.anchor)};
  const auto predicted = decode_boxes(logits, own);
  parts.box = ((1.0 - ciou_rows(predicted, targets.box)) * targets.weight).sum() / divisor;
  const auto corners = targets.box.chunk(2, 1);
  const auto distances =
      torch::cat({own.centre_px - corners[0], corners[1] - own.centre_px}, 1) / own.stride_px;
  parts.bins = (bin_loss_rows(logits, distances) * targets.weight).sum() / divisor;
  return parts;
}

}  // namespace segsim::perception
