#include "perception/internal/centernet/loss.h"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check.h"
#include "perception/internal/centernet/network.h"
#include "perception/internal/loss/ciou.h"

namespace segsim::perception::centernet {
namespace {

constexpr double kGaussianShare = 0.54;  ///< Of the box's half sides.

double inclusive_area_px2(const core::BoxPx& box) {
  return (double{box.x1} - box.x0 + 1.0) * (double{box.y1} - box.y0 + 1.0);
}

/// Cells of one object's Gaussian; none of them leaves the map.
struct Window {
  std::int64_t centre_x, centre_y, radius_x, radius_y;
  std::int64_t x0, y0, x1, y1;  ///< Inclusive.

  Window(const core::BoxPx& box, std::int64_t height, std::int64_t width) {
    const auto cell = [](float a_px, float b_px, std::int64_t cells) {
      const auto middle = static_cast<std::int64_t>((double{a_px} + b_px) / 2.0 / kStride_px);
      return std::clamp<std::int64_t>(middle, 0, cells - 1);
    };
    const auto radius = [](float a_px, float b_px, std::int64_t cells) {
      const auto clipped = [&](float v_px) {
        return std::clamp(double{v_px} / kStride_px, 0.0, static_cast<double>(cells - 1));
      };
      return static_cast<std::int64_t>((clipped(b_px) - clipped(a_px)) / 2.0 * kGaussianShare);
    };
    centre_x = cell(box.x0, box.x1, width);
    centre_y = cell(box.y0, box.y1, height);
    radius_x = radius(box.x0, box.x1, width);
    radius_y = radius(box.y0, box.y1, height);
    x0 = std::max<std::int64_t>(0, centre_x - radius_x);
    y0 = std::max<std::int64_t>(0, centre_y - radius_y);
    x1 = std::min(width - 1, centre_x + radius_x);
    y1 = std::min(height - 1, centre_y + radius_y);
  }

  [[nodiscard]] double gaussian(std::int64_t y, std::int64_t x) const {
    const auto term = [](std::int64_t distance, std::int64_t radius) {
      const double sigma = static_cast<double>(2 * radius + 1) / 6.0;
      const double ratio = static_cast<double>(distance) / sigma;
      return ratio * ratio / 2.0;
    };
    return std::exp(-term(x - centre_x, radius_x) - term(y - centre_y, radius_y));
  }

  template <class Action>
  void for_each(const Action& action) const {
    for (std::int64_t y = y0; y <= y1; ++y) {
      for (std::int64_t x = x0; x <= x1; ++x) action(y, x, gaussian(y, x));
    }
  }
};

void add_object(const LabeledBox& object, std::int64_t image, Targets& targets) {
  const std::int64_t height = targets.heat.size(2), width = targets.heat.size(3);
  const Window window(object.box, height, width);
  double sum = 0.0;
  window.for_each([&](std::int64_t, std::int64_t, double g) { sum += g; });
  const double share = std::log(inclusive_area_px2(object.box)) / sum;
  auto heat = targets.heat.accessor<float, 4>()[image][object.class_index];
  auto box = targets.box.accessor<float, 4>()[image];
  auto weight = targets.weight.accessor<float, 3>()[image];
  const float corners[] = {object.box.x0, object.box.y0, object.box.x1, object.box.y1};
  window.for_each([&](std::int64_t y, std::int64_t x, double g) {
    heat[y][x] = std::max(heat[y][x], static_cast<float>(g));
    weight[y][x] = static_cast<float>(g * share);
    for (int i = 0; i < 4; ++i) box[i][y][x] = corners[i];
  });
}

/// Cells that begin inside the box are not told that its class is absent.
void mask_ignored(const LabeledBox& object, std::int64_t image, Targets& targets) {
  auto judged = targets.judged[image][object.class_index];
  const auto range = [](float a_px, float b_px, std::int64_t cells) {
    const auto cell = [cells](double v) {
      return std::clamp<std::int64_t>(static_cast<std::int64_t>(v), 0, cells);
    };
    const std::int64_t from = cell(std::floor(double{a_px} / kStride_px));
    return std::pair(from, std::max(from, cell(std::ceil(double{b_px} / kStride_px))) - from);
  };
  const auto [y, height] = range(object.box.y0, object.box.y1, judged.size(0));
  const auto [x, width] = range(object.box.x0, object.box.x1, judged.size(1));
  judged.narrow(0, y, height).narrow(1, x, width).fill_(0.0F);
}

/// Corners of every cell's box, [batch, 4, h, w] in pixels of the input.
torch::Tensor predicted_boxes(const torch::Tensor& sides_px) {
  const auto first_px = [&](std::int64_t cells) {
    return torch::arange(cells, sides_px.options()) * static_cast<double>(kStride_px);
  };
  const auto x = first_px(sides_px.size(3)).view({1, 1, 1, -1});
  const auto y = first_px(sides_px.size(2)).view({1, 1, -1, 1});
  const auto side = sides_px.split(1, 1);
  return torch::cat({x - side[0], y - side[1], x + side[2], y + side[3]}, 1);
}

/// Summed, with a power of 2 for confident answers and one of 4 near centres.
torch::Tensor focal_sum(const torch::Tensor& logits, const torch::Tensor& heat,
                        const torch::Tensor& judged) {
  const auto p = logits.sigmoid();
  const auto centre = (heat == 1.0).to(torch::kFloat32);
  const auto positive = (1 - p).square() * torch::log_sigmoid(logits) * centre;
  const auto negative = (1 - heat).pow(4) * p.square() * torch::log_sigmoid(-logits) * judged;
  return -(positive + negative).sum();
}

}  // namespace

Targets make_targets(const std::vector<std::vector<LabeledBox>>& truth,
                     std::int64_t class_count, std::int64_t height_cells,
                     std::int64_t width_cells) {
  const auto batch = static_cast<std::int64_t>(truth.size());
  Targets targets{torch::zeros({batch, class_count, height_cells, width_cells}),
                  torch::ones({batch, class_count, height_cells, width_cells}),
                  torch::zeros({batch, 4, height_cells, width_cells}),
                  torch::zeros({batch, height_cells, width_cells})};
  for (std::int64_t image = 0; image < batch; ++image) {
    std::vector<LabeledBox> objects = truth[static_cast<std::size_t>(image)];
    std::stable_sort(objects.begin(), objects.end(), [](const auto& a, const auto& b) {
      return inclusive_area_px2(a.box) > inclusive_area_px2(b.box);
    });
    for (const LabeledBox& object : objects) {
      SEGSIM_CHECK(object.class_index >= 0 && object.class_index < class_count,
                   std::to_string(object.class_index));
      object.not_scored() ? mask_ignored(object, image, targets)
                          : add_object(object, image, targets);
    }
  }
  return targets;
}

torch::Tensor inclusive_ciou_rows(const torch::Tensor& a, const torch::Tensor& b) {
  const auto ca = a.unbind(1), cb = b.unbind(1);
  const auto area = [](const std::vector<torch::Tensor>& c) {
    return (c[2] - c[0] + 1).clamp_min(0) * (c[3] - c[1] + 1).clamp_min(0);
  };
  const auto overlap_side = [&](std::size_t low) {
    return (torch::minimum(ca[low + 2], cb[low + 2]) - torch::maximum(ca[low], cb[low]) + 1)
        .clamp_min(0);
  };
  const auto both = overlap_side(0) * overlap_side(1);
  const auto iou = both / (area(ca) + area(cb) - both);

  const auto hull_w = torch::maximum(ca[2], cb[2]) - torch::minimum(ca[0], cb[0]);
  const auto hull_h = torch::maximum(ca[3], cb[3]) - torch::minimum(ca[1], cb[1]);
  const auto dx = (ca[0] + ca[2] - cb[0] - cb[2]) / 2;
  const auto dy = (ca[1] + ca[3] - cb[1] - cb[3]) / 2;
  const auto distance = (dx * dx + dy * dy) / (hull_w * hull_w + hull_h * hull_h + kCiouEps);

  const auto diagonal = [](const std::vector<torch::Tensor>& c) {
    return torch::atan2(c[2] - c[0],
                        c[3] - c[1] + kCiouEps);  // Empty boxes have a derivative.
  };
  const auto angle = diagonal(cb) - diagonal(ca);
  const auto v = 4.0 / (std::numbers::pi * std::numbers::pi) * angle * angle;
  const auto alpha =
      (torch::where(iou > 0.5, v / (1 - iou + v + kCiouEps), torch::zeros_like(v))).detach();
  return iou - distance - alpha * v;
}

HeatLossParts heat_loss(const HeatMaps& maps,
                        const std::vector<std::vector<LabeledBox>>& truth) {
  const auto& logits = maps.classes;
  Targets targets = make_targets(truth, logits.size(1), logits.size(2), logits.size(3));
  const double centres = (targets.heat == 1.0).sum().item<double>();
  const double weight_sum = targets.weight.sum(torch::kFloat64).item<double>();
  const auto there = [&](const torch::Tensor& tensor) { return tensor.to(logits.device()); };

  HeatLossParts parts;
  parts.classes =
      focal_sum(logits, there(targets.heat), there(targets.judged)) / std::max(1.0, centres);
  const auto cells = targets.weight.flatten().nonzero().squeeze(1);
  const auto rows = [](const torch::Tensor& boxes) {
    return boxes.permute({0, 2, 3, 1}).reshape({-1, 4});
  };
  const auto own = rows(predicted_boxes(maps.sides_px)).index_select(0, there(cells));
  const auto wanted = there(rows(targets.box).index_select(0, cells));
  const auto weight = there(targets.weight.flatten().index_select(0, cells));
  parts.box = ((1 - inclusive_ciou_rows(own, wanted)) * weight).sum() / (weight_sum + 1e-4);
  return parts;
}

}  // namespace segsim::perception::centernet
