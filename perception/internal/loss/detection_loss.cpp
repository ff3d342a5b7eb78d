#include "perception/internal/loss/detection_loss.h"

#include <numbers>

#include "perception/internal/loss/ciou.h"
#include "perception/internal/loss/loss_targets.h"

namespace segsim::perception {
namespace {

LossTargets make_targets(const RawOutput& output, const Anchors& anchors,
                         const std::vector<std::vector<LabeledBox>>& truth,
                         const AssignerRule& rule) {
  const torch::NoGradGuard no_grad;
  const auto scores = output.classes.sigmoid(), boxes = decode_boxes(output.box, anchors);
  return boxes.is_cpu() ? targets_on_host(scores, boxes, anchors, truth, rule)
                        : targets_on_device(scores, boxes, anchors, truth, rule);
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
  const LossTargets targets = make_targets(output, anchors, truth, rule);
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
