#include "perception/models/internal/roi_align.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace segsim::perception {
namespace {

/// Bilinear tap of a plane; 0 more than a pixel outside, the edge's value up to there.
struct Tap {
  std::int64_t corner[4] = {0, 0, 0, 0};
  float weight[4] = {0, 0, 0, 0};
};

Tap tap_at(double y, double x, std::int64_t h, std::int64_t w) {
  Tap tap;
  if (!(y >= -1.0 && y <= static_cast<double>(h) && x >= -1.0 &&
        x <= static_cast<double>(w))) {
    return tap;
  }
  const auto split = [](double at, std::int64_t n, std::int64_t& low, std::int64_t& high) {
    at = std::max(at, 0.0);
    low = std::min(static_cast<std::int64_t>(at), n - 1);
    high = std::min(low + 1, n - 1);
    return low >= n - 1 ? 0.0 : at - static_cast<double>(low);
  };
  std::int64_t y0 = 0, y1 = 0, x0 = 0, x1 = 0;
  const double fy = split(y, h, y0, y1), fx = split(x, w, x0, x1);
  const std::int64_t corner[4] = {y0 * w + x0, y0 * w + x1, y1 * w + x0, y1 * w + x1};
  const double weight[4] = {(1 - fy) * (1 - fx), (1 - fy) * fx, fy * (1 - fx), fy * fx};
  for (int k = 0; k < 4; ++k) {
    tap.corner[k] = corner[k];
    tap.weight[k] = static_cast<float>(weight[k]);
  }
  return tap;
}

struct Cell {
  std::vector<Tap> taps;
};

/// Taps of all cells of one box, row by row.
std::vector<Cell> cells_of(const float* box, std::int64_t h, std::int64_t w,
                           const RoiAlignRule& rule) {
  const double offset = rule.half_pixel ? 0.5 : 0.0;
  const double x0 = box[0] * rule.spatial_scale - offset,
               y0 = box[1] * rule.spatial_scale - offset;
  double width = box[2] * rule.spatial_scale - offset - x0;
  double height = box[3] * rule.spatial_scale - offset - y0;
  if (!rule.half_pixel) {  // The older rule forces boxes to a pixel.
    width = std::max(width, 1.0);
    height = std::max(height, 1.0);
  }
  const double cell_h = height / static_cast<double>(rule.height);
  const double cell_w = width / static_cast<double>(rule.width);
  const auto samples = [&](double cell) {
    constexpr double kMost = 4096;  // Wider than any image's cell.
    if (rule.sampling_ratio > 0) return rule.sampling_ratio;
    return static_cast<std::int64_t>(std::clamp(std::ceil(cell), 0.0, kMost));
  };
  const std::int64_t rows = samples(cell_h), columns = samples(cell_w);
  std::vector<Cell> cells;
  for (std::int64_t i = 0; i < rule.height; ++i) {
    for (std::int64_t j = 0; j < rule.width; ++j) {
      Cell cell;
      for (std::int64_t a = 0; a < rows; ++a) {
        for (std::int64_t b = 0; b < columns; ++b) {
          const double y = y0 + (static_cast<double>(i) +
                                 (static_cast<double>(a) + 0.5) / static_cast<double>(rows)) *
                                    cell_h;
          const double x = x0 + (static_cast<double>(j) + (static_cast<double>(b) + 0.5) /
                                                              static_cast<double>(columns)) *
                                    cell_w;
          cell.taps.push_back(tap_at(y, x, h, w));
        }
      }
      cells.push_back(std::move(cell));
    }
  }
  return cells;
}

float pool(const float* plane, const Cell& cell, bool take_max) {
  if (cell.taps.empty()) return 0.0F;
  float sum = 0.0F, best = std::numeric_limits<float>::lowest();
  for (const Tap& tap : cell.taps) {
    float value = 0.0F;
    for (int k = 0; k < 4; ++k) {
      const float part = tap.weight[k] * plane[tap.corner[k]];
      value += part;
      best = std::max(best, part);  // ONNX takes the maximum of the weighted corners.
    }
    sum += value;
  }
  return take_max ? best : sum / static_cast<float>(cell.taps.size());
}

}  // namespace

at::Tensor roi_align(const at::Tensor& input, const at::Tensor& boxes,
                     const at::Tensor& images, const RoiAlignRule& rule) {
  const at::Tensor x = input.to(at::kFloat).contiguous(),
                   b = boxes.to(at::kFloat).contiguous();
  const at::Tensor which = images.to(at::kLong).contiguous();
  const std::int64_t n = b.size(0), channels = x.size(1), h = x.size(2), w = x.size(3);
  at::Tensor result = at::zeros({n, channels, rule.height, rule.width}, at::kFloat);
  float* out = result.data_ptr<float>();
  for (std::int64_t i = 0; i < n && h > 0 && w > 0; ++i) {
    const auto cells = cells_of(b.data_ptr<float>() + 4 * i, h, w, rule);
    const std::int64_t image = which.data_ptr<std::int64_t>()[i];
    for (std::int64_t c = 0; c < channels; ++c) {
      const float* plane = x.data_ptr<float>() + (image * channels + c) * h * w;
      for (const Cell& cell : cells) *out++ = pool(plane, cell, rule.take_max);
    }
  }
  return result;
}

std::vector<std::int64_t> greedy_suppression(const float* boxes, const float* scores,
                                             std::vector<std::int64_t> candidates,
                                             double max_iou, std::int64_t max_count) {
  std::stable_sort(candidates.begin(), candidates.end(),
                   [&](std::int64_t a, std::int64_t b) { return scores[a] > scores[b]; });
  const auto side = [](float a, float b) { return std::max(a, b) - std::min(a, b); };
  const auto overlap = [](float a0, float a1, float b0, float b1) {
    return std::max(0.0F, std::min(std::max(a0, a1), std::max(b0, b1)) -
                              std::max(std::min(a0, a1), std::min(b0, b1)));
  };
  std::vector<std::int64_t> kept;
  for (const std::int64_t i : candidates) {
    if (static_cast<std::int64_t>(kept.size()) >= max_count) break;
    const float* a = boxes + 4 * i;
    const bool hidden = std::any_of(kept.begin(), kept.end(), [&](std::int64_t j) {
      const float* b = boxes + 4 * j;
      const double both =
          double{overlap(a[0], a[2], b[0], b[2])} * double{overlap(a[1], a[3], b[1], b[3])};
      const double all = double{side(a[0], a[2])} * double{side(a[1], a[3])} +
                         double{side(b[0], b[2])} * double{side(b[1], b[3])} - both;
      return all > 0.0 && both / all > max_iou;
    });
    if (!hidden) kept.push_back(i);
  }
  return kept;
}

}  // namespace segsim::perception
