// Operators on boxes.
#include <limits>

#include "perception/models/internal/onnx/onnx_node_call.h"
#include "perception/models/internal/roi_align.h"

namespace segsim::perception::graph {
namespace {

using at::Tensor;

/// [boxes, 4] as opposite corners.
Tensor corners(const Tensor& boxes, bool centres) {
  if (!centres) return boxes;
  const Tensor middle = boxes.slice(-1, 0, 2), half = boxes.slice(-1, 2, 4) / 2;
  return at::cat({middle - half, middle + half}, -1).contiguous();
}

Values non_max_suppression(const NodeCall& call) {
  const Tensor boxes =
      corners(call.input(0).to(at::kFloat), call.attribute_or("center_point_box", 0) != 0)
          .contiguous();
  const Tensor scores = call.input(1).to(at::kFloat).contiguous();
  if (boxes.dim() != 3 || boxes.size(2) != 4 || scores.dim() != 3 ||
      scores.size(0) != boxes.size(0) || scores.size(2) != boxes.size(1)) {
    call.fail("boxes [b, n, 4] and scores [b, classes, n]",
              shape_text(boxes.sizes().vec()) + " and " + shape_text(scores.sizes().vec()));
  }
  const std::int64_t most = call.has(2) ? call.integer(2) : 0;
  const double max_iou = call.has(3) ? call.real(3) : 0.0;
  const double threshold =
      call.has(4) ? call.real(4) : -std::numeric_limits<double>::infinity();
  const std::int64_t n = boxes.size(1), classes = scores.size(1);
  std::vector<std::int64_t> rows;
  for (std::int64_t b = 0; b < boxes.size(0); ++b) {
    for (std::int64_t c = 0; c < classes; ++c) {
      const float* of_class = scores.data_ptr<float>() + (b * classes + c) * n;
      std::vector<std::int64_t> candidates;
      for (std::int64_t i = 0; i < n; ++i) {
        if (double{of_class[i]} > threshold) candidates.push_back(i);
      }
      for (const std::int64_t i :
           greedy_suppression(boxes.data_ptr<float>() + b * n * 4, of_class,
                              std::move(candidates), max_iou, most)) {
        rows.insert(rows.end(), {b, c, i});
      }
    }
  }
  return {at::tensor(at::ArrayRef<std::int64_t>(rows), at::kLong).reshape({-1, 3})};
}

Values region_align(const NodeCall& call) {
  const Tensor &x = call.input(0), &boxes = call.input(1);
  RoiAlignRule rule;
  rule.height = call.attribute_or("output_height", 1);
  rule.width = call.attribute_or("output_width", 1);
  rule.sampling_ratio = call.attribute_or("sampling_ratio", 0);
  rule.spatial_scale = call.real_or("spatial_scale", 1.0);
  const std::string mode = call.text_or("mode", "avg");
  const std::string coordinates =
      call.text_or("coordinate_transformation_mode",
                   call.opset() >= 16 ? "half_pixel" : "output_half_pixel");
  rule.half_pixel = coordinates == "half_pixel";
  rule.take_max = mode == "max";
  constexpr std::int64_t kMostCells = 1 << 12;
  const bool fits = x.dim() == 4 && boxes.dim() == 2 && boxes.size(1) == 4 &&
                    call.input(2).dim() == 1 && call.input(2).size(0) == boxes.size(0) &&
                    rule.height >= 1 && rule.height <= kMostCells && rule.width >= 1 &&
                    rule.width <= kMostCells && rule.sampling_ratio <= kMostCells &&
                    (mode == "avg" || mode == "max") &&
                    (rule.half_pixel || coordinates == "output_half_pixel");
  if (!fits) {
    call.fail("X [n, c, h, w], rois [boxes, 4], batch_indices [boxes], known modes",
              shape_text(x.sizes().vec()) + ", " + shape_text(boxes.sizes().vec()) + ", " +
                  mode + ", " + coordinates);
  }
  call.check_size(std::vector{boxes.size(0), x.size(1), rule.height, rule.width});
  return {roi_align(x, boxes, call.indices(call.input(2), x.size(0)), rule)};
}

constexpr Operator kOperators[] = {
    {"NonMaxSuppression", 10, kLastOpset, 2, 5, "center_point_box", non_max_suppression},
    {"RoiAlign", 10, kLastOpset, 3, 3,
     "coordinate_transformation_mode mode output_height output_width sampling_ratio "
     "spatial_scale",
     region_align},
};

}  // namespace

std::span<const Operator> region_operators() { return kOperators; }

}  // namespace segsim::perception::graph
