#include "perception/yolov13/head_output.h"

#include "core/check.h"
#include "perception/internal/loss/detection_loss.h"
#include "perception/yolov13/internal/tensor_convert.h"

namespace segsim::perception::yolov13 {
namespace {

std::vector<float> values_of(const torch::Tensor& tensor) {
  const auto flat = tensor.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  return {flat.data_ptr<float>(), flat.data_ptr<float>() + flat.numel()};
}

void check_sizes(const HeadOutput& output) {
  const auto rows = static_cast<std::size_t>(output.batch * output.anchors());
  SEGSIM_CHECK(
      output.batch > 0 && output.class_count > 0 && output.height_px % 32 == 0 &&
          output.width_px % 32 == 0 && output.box.size() == rows * 4 * kRegBins &&
          output.classes.size() == rows * static_cast<std::size_t>(output.class_count),
      "sizes of a head output");
}

}  // namespace

std::int64_t HeadOutput::anchors() const {
  std::int64_t count = 0;
  for (const int stride : kStrides) {
    count += std::int64_t{height_px / stride} * (width_px / stride);
  }
  return count;
}

HeadOutput to_head_output(const RawOutput& raw, int height_px, int width_px) {
  return {static_cast<int>(raw.classes.size(0)),
          static_cast<int>(raw.classes.size(2)),
          height_px,
          width_px,
          values_of(raw.box),
          values_of(raw.classes)};
}

RawOutput to_raw_output(const HeadOutput& output) {
  check_sizes(output);
  const std::int64_t anchors = output.anchors();
  return {torch::tensor(output.box).view({output.batch, anchors, 4 * kRegBins}),
          torch::tensor(output.classes).view({output.batch, anchors, output.class_count})};
}

std::vector<float> decode(const HeadOutput& output) {
  const torch::InferenceMode inference;
  const RawOutput raw = to_raw_output(output);
  const auto corners =
      decode_boxes(raw.box, make_anchors(output.height_px, output.width_px, torch::kFloat32));
  const auto sides = corners.chunk(2, -1);
  return values_of(
      torch::cat({(sides[0] + sides[1]) / 2, sides[1] - sides[0], raw.classes.sigmoid()}, -1)
          .transpose(1, 2));
}

LossValues loss(const HeadOutput& output, const std::vector<std::vector<LabeledBox>>& truth) {
  SEGSIM_CHECK(truth.size() == static_cast<std::size_t>(output.batch), "one list per image");
  for (const auto& image : truth) {
    for (const LabeledBox& box : image) {
      SEGSIM_CHECK(box.class_index >= 0 && box.class_index < output.class_count,
                   std::to_string(box.class_index));
    }
  }
  const torch::NoGradGuard no_grad;
  const LossParts parts = detection_loss(
      to_raw_output(output), make_anchors(output.height_px, output.width_px, torch::kFloat32),
      truth, kYoloRule);
  return {parts.box.item<double>(), parts.classes.item<double>(), parts.bins.item<double>(),
          parts.total(output.batch).item<double>()};
}

}  // namespace segsim::perception::yolov13
