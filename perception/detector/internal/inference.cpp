#include "perception/detector/internal/inference.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/check.h"
#include "perception/internal/centernet/decode.h"
#include "perception/internal/network/autocast.h"
#include "perception/internal/network/score.h"

namespace segsim::perception {
namespace {

/// Expectation of the softmax over one side's bins, in strides.
float expected_distance(const float* logits) {
  const float top = *std::max_element(logits, logits + kRegBins);
  float sum = 0.0F, moment = 0.0F;
  for (int bin = 0; bin < kRegBins; ++bin) {
    const float p = std::exp(logits[bin] - top);
    sum += p;
    moment += p * static_cast<float>(bin);
  }
  return moment / sum;
}

core::BoxPx decode(const float* centre_px, float stride_px, const float* logits) {
  const auto side = [&](int i) {
    return expected_distance(logits + i * kRegBins) * stride_px;
  };
  return {centre_px[0] - side(0), centre_px[1] - side(1), centre_px[0] + side(2),
          centre_px[1] + side(3)};
}

/// Red, green, blue of each pixel over 255. @returns the end of what was written.
float* to_unit_range(const core::Image<core::Rgb8>& square, float* out) {
  std::array<float, 256> level;
  for (std::size_t i = 0; i < level.size(); ++i) level[i] = static_cast<float>(i) / 255.0F;
  for (const core::Rgb8 pixel : square.pixels()) {
    out[0] = level[pixel.r];
    out[1] = level[pixel.g];
    out[2] = level[pixel.b];
    out += 3;
  }
  return out;
}

/// Each output pixel is the mean of the input over its extent.
void fill_area_weights(torch::Tensor& weights) {
  const int64_t out = weights.size(0), in = weights.size(1);
  const double scale = static_cast<double>(in) / static_cast<double>(out);
  for (int64_t o = 0; o < out; ++o) {
    const double from = static_cast<double>(o) * scale, to = from + scale;
    for (auto i = static_cast<int64_t>(from); i < in && static_cast<double>(i) < to; ++i) {
      const double share =
          std::min(to, static_cast<double>(i + 1)) - std::max(from, static_cast<double>(i));
      weights.data_ptr<float>()[o * in + i] = static_cast<float>(share / scale);
    }
  }
}

/// Between the two nearest pixel centres; borders repeat.
void fill_linear_weights(torch::Tensor& weights) {
  const int64_t out = weights.size(0), in = weights.size(1);
  const double scale = static_cast<double>(in) / static_cast<double>(out);
  for (int64_t o = 0; o < out; ++o) {
    const double at = std::clamp((static_cast<double>(o) + 0.5) * scale - 0.5, 0.0,
                                 static_cast<double>(in - 1));
    const auto low = static_cast<int64_t>(at);
    const auto share = static_cast<float>(at - static_cast<double>(low));
    float* row = weights.data_ptr<float>() + o * in;
    row[low] += 1.0F - share;
    row[std::min(low + 1, in - 1)] += share;
  }
}

}  // namespace

Inference::Inference(InferenceNetwork network, int input_px, const torch::Device& device,
                     bool mixed_precision)
    : network_(std::move(network)),
      input_px_(input_px),
      device_(device),
      mixed_precision_(mixed_precision),
      anchors_(make_anchors(input_px, torch::TensorOptions(device))),
      host_anchors_(make_anchors(input_px, torch::TensorOptions(torch::kCPU))) {
  SEGSIM_CHECK(!mixed_precision || !device.is_cpu(), "mixed precision on the CPU");
  // Weights and anchors came by the default stream; pictures may come by another.
  if (!device.is_cpu()) torch::cuda::synchronize();
}

torch::Tensor Inference::upload(std::span<const core::Image<core::Rgb8>> squares) {
  SEGSIM_CHECK(!squares.empty(), "no image");
  const auto images = static_cast<int64_t>(squares.size());
  if (device_.is_cpu()) {
    // Channels innermost, as oneDNN wants them (onednn.h) and as the pixels already lie.
    auto tensor = torch::empty({images, 3, input_px_, input_px_},
                               torch::TensorOptions(torch::kFloat32)
                                   .memory_format(torch::MemoryFormat::ChannelsLast));
    float* out = tensor.data_ptr<float>();
    for (const auto& square : squares) out = to_unit_range(square, out);
    return tensor;
  }
  // Bytes through page-locked memory: a quarter of the floats, and the copy needs no detour.
  if (!staging_.defined() || staging_.size(0) < images) {
    staging_ = torch::empty({images, input_px_, input_px_, 3},
                            torch::TensorOptions(torch::kUInt8).pinned_memory(true));
  }
  const std::size_t count = squares[0].size();
  auto* bytes = staging_.data_ptr<std::uint8_t>();
  for (const auto& square : squares) {
    static_assert(sizeof(core::Rgb8) == 3);
    bytes =
        std::copy_n(reinterpret_cast<const std::uint8_t*>(square.data()), 3 * count, bytes);
  }
  return staging_.narrow(0, 0, images)
      .to(device_, /*non_blocking=*/true)
      .permute({0, 3, 1, 2})
      .to(torch::kFloat32)
      .div(255.0)
      .contiguous();
}

const Inference::Scaling& Inference::scaling_for(const Letterbox& fit) {
  Scaling& scaling = scalings_[{fit.image_width_px, fit.image_height_px}];
  if (scaling.x.defined()) return scaling;
  const bool shrinks = fit.scale_x < 1.0 || fit.scale_y < 1.0;
  const auto weights = [&](int out, int in) {
    auto matrix = torch::zeros({out, in}, torch::kFloat32);
    shrinks ? fill_area_weights(matrix) : fill_linear_weights(matrix);
    return matrix.to(device_);
  };
  scaling.x = weights(fit.scaled_width_px(), fit.image_width_px);
  scaling.y = weights(fit.scaled_height_px(), fit.image_height_px);
  return scaling;
}

torch::Tensor Inference::letterbox_on_device(const torch::Tensor& rgb, const Letterbox& fit) {
  SEGSIM_CHECK(rgb.dim() == 4 && rgb.size(1) == fit.image_height_px &&
                   rgb.size(2) == fit.image_width_px && rgb.size(3) == 3,
               "pictures of another size");
  const torch::InferenceMode inference;
  const int width = fit.scaled_width_px(), height = fit.scaled_height_px();
  auto levels = rgb.permute({0, 3, 1, 2}).to(torch::kFloat32);
  if (width != fit.image_width_px || height != fit.image_height_px) {
    const Scaling& scaling = scaling_for(fit);
    levels = torch::matmul(torch::matmul(scaling.y, levels), scaling.x.t());
    levels = levels.add(0.5).floor();
  }
  auto square = torch::full({rgb.size(0), 3, input_px_, input_px_},
                            static_cast<float>(kLetterboxGrey), levels.options());
  square.narrow(2, fit.offset_y_px, height).narrow(3, fit.offset_x_px, width).copy_(levels);
  return square.div_(255.0);
}

std::vector<Candidates> Inference::candidates(const torch::Tensor& input,
                                              float score_threshold) const {
  const torch::InferenceMode inference;
  NetworkOutput output;
  {
    const AutocastScope autocast(mixed_precision_);
    output = network_(input);
  }
  return std::visit([&](const auto& kind) { return decode(kind, score_threshold); },
                    to_float32(output));
}

std::vector<Candidates> Inference::decode(const RawOutput& output,
                                          float score_threshold) const {
  return device_.is_cpu() ? candidates_on_host(output, host_anchors_, score_threshold)
                          : candidates_on_device(output, anchors_, score_threshold);
}

std::vector<Candidates> Inference::decode(const HeatMaps& maps, float score_threshold) const {
  return device_.is_cpu() ? centernet::peaks_on_host(maps, score_threshold)
                          : centernet::peaks_on_device(maps, score_threshold);
}

std::vector<Candidates> candidates_on_device(const RawOutput& output, const Anchors& anchors,
                                             float score_threshold) {
  std::vector<Candidates> found(static_cast<std::size_t>(output.classes.size(0)));
  const auto scores = output.classes.sigmoid();
  const auto hits = (scores >= score_threshold).nonzero();  // [k, 3]: image, anchor, class.
  if (hits.size(0) == 0) return found;
  const auto column = hits.unbind(1);
  const Anchors own{anchors.centre_px.index_select(0, column[1]),
                    anchors.stride_px.index_select(0, column[1])};
  const auto boxes = decode_boxes(output.box.index({column[0], column[1]}), own);
  const auto hit_scores = scores.index({column[0], column[1], column[2]});
  // One copy for all: numbers of images, anchors and classes are exact in float64.
  const auto rows =
      torch::cat({hits.to(torch::kFloat64), hit_scores.unsqueeze(1).to(torch::kFloat64),
                  boxes.to(torch::kFloat64)},
                 1)
          .to(torch::kCPU)
          .contiguous();
  const double* row = rows.data_ptr<double>();
  for (int64_t i = 0; i < rows.size(0); ++i, row += rows.size(1)) {
    const auto value = [row](int k) { return static_cast<float>(row[k]); };
    found[static_cast<std::size_t>(row[0])].push_back(
        {static_cast<int>(row[2]), value(3), {value(4), value(5), value(6), value(7)}});
  }
  return found;
}

std::vector<Candidates> candidates_on_host(const RawOutput& output, const Anchors& anchors,
                                           float score_threshold) {
  const auto box = output.box.contiguous(), classes = output.classes.contiguous();
  const int64_t images = classes.size(0), count = classes.size(1), names = classes.size(2);
  const float* box_logits = box.data_ptr<float>();
  const float* class_logits = classes.data_ptr<float>();
  const float* centres = anchors.centre_px.data_ptr<float>();
  const float* strides = anchors.stride_px.data_ptr<float>();
  const float low = surely_low_logit(score_threshold);
  std::vector<Candidates> found(static_cast<std::size_t>(images));
  for (int64_t image = 0; image < images; ++image) {
    for (int64_t a = 0; a < count; ++a, box_logits += 4 * kRegBins, class_logits += names) {
      bool decoded = false;
      core::BoxPx corners;
      for (int64_t c = 0; c < names; ++c) {
        if (class_logits[c] < low) continue;
        const float score = score_of_logit(class_logits[c]);
        if (!(score >= score_threshold)) continue;
        if (!decoded) corners = decode(centres + 2 * a, strides[a], box_logits);
        decoded = true;
        found[static_cast<std::size_t>(image)].push_back(
            {static_cast<int>(c), score, corners});
      }
    }
  }
  return found;
}

}  // namespace segsim::perception
