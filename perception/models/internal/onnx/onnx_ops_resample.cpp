// Resize, Upsample and GridSample.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "perception/models/internal/onnx/onnx_node_call.h"
#include "perception/models/internal/resample.h"

namespace segsim::perception::graph {
namespace {

using at::Tensor;
using Sizes = std::vector<std::int64_t>;

/// What Resize does to one axis.
struct AxisPlan {
  std::int64_t input = 0, output = 0;
  double scale = 1.0;
  double roi_start = 0.0, roi_end = 1.0;  ///< tf_crop_and_resize, in shares of the axis.
};

/// Place in the input of output sample i, as the standard's coordinate_transformation_mode
/// says.
std::function<double(std::int64_t)> coordinate_rule(const NodeCall& call,
                                                    const std::string& mode,
                                                    const AxisPlan& p) {
  const double scale = p.scale;
  const auto in = static_cast<double>(p.input), out = static_cast<double>(p.output);
  if (mode == "half_pixel" || (mode == "pytorch_half_pixel" && p.output > 1)) {
    return [=](std::int64_t i) { return (static_cast<double>(i) + 0.5) / scale - 0.5; };
  }
  if (mode == "pytorch_half_pixel") return [](std::int64_t) { return 0.0; };
  if (mode == "asymmetric") {
    return [=](std::int64_t i) { return static_cast<double>(i) / scale; };
  }
  if (mode == "align_corners") {
    return [=](std::int64_t i) {
      return out <= 1.0 ? 0.0 : static_cast<double>(i) * (in - 1.0) / (out - 1.0);
    };
  }
  if (mode == "tf_half_pixel_for_nn") {
    return [=](std::int64_t i) { return (static_cast<double>(i) + 0.5) / scale; };
  }
  if (mode == "half_pixel_symmetric") {
    // The output is cut to whole samples; the rest is split between both ends.
    const double adjustment = out / (scale * in);
    const double offset = in / 2.0 * (1.0 - adjustment);
    return
        [=](std::int64_t i) { return offset + (static_cast<double>(i) + 0.5) / scale - 0.5; };
  }
  if (mode == "tf_crop_and_resize") {
    const double start = p.roi_start, end = p.roi_end;
    return [=](std::int64_t i) {
      if (out <= 1.0) return 0.5 * (start + end) * (in - 1.0);
      return start * (in - 1.0) +
             static_cast<double>(i) * (end - start) * (in - 1.0) / (out - 1.0);
    };
  }
  call.fail("a coordinate_transformation_mode that is supported", mode);
}

std::function<std::int64_t(double)> nearest_rule(const NodeCall& call,
                                                 const std::string& mode) {
  const auto whole = [](double x) { return static_cast<std::int64_t>(x); };
  if (mode == "floor") return [whole](double x) { return whole(std::floor(x)); };
  if (mode == "ceil") return [whole](double x) { return whole(std::ceil(x)); };
  if (mode == "round_prefer_floor") {
    return [whole](double x) { return whole(std::ceil(x - 0.5)); };
  }
  if (mode == "round_prefer_ceil") {
    return [whole](double x) { return whole(std::floor(x + 0.5)); };
  }
  call.fail("a nearest_mode that is supported", mode);
}

Tensor resample_axis(const Tensor& x, std::int64_t axis, const Resampling& plan) {
  const auto outputs = static_cast<std::int64_t>(plan.indices.size()) / plan.taps;
  const Tensor indices = at::tensor(at::ArrayRef<std::int64_t>(plan.indices), at::kLong)
                             .view({outputs, plan.taps});
  const auto pick = [&](std::int64_t k) {
    return at::index_select(x, axis, indices.select(1, k).contiguous());
  };
  if (plan.taps == 1) return pick(0);
  Sizes line(static_cast<std::size_t>(x.dim()), 1);
  line[static_cast<std::size_t>(axis)] = outputs;
  const Tensor weights = at::tensor(at::ArrayRef<float>(plan.weights), at::kFloat)
                             .to(x.scalar_type())
                             .view({outputs, plan.taps});
  Tensor sum;
  for (std::int64_t k = 0; k < plan.taps; ++k) {
    const Tensor weight = weights.select(1, k);
    if (weight.eq(0).all().item<bool>()) continue;
    const Tensor part = pick(k) * weight.reshape(line);
    sum = sum.defined() ? sum + part : part;
  }
  Sizes empty = x.sizes().vec();
  empty[static_cast<std::size_t>(axis)] = outputs;
  return sum.defined() ? sum : at::zeros(empty, x.options());
}

std::vector<double> reals(const NodeCall& call, std::size_t i) {
  const Tensor flat = call.input(i).to(at::kDouble).contiguous().reshape({-1});
  const auto* data = flat.data_ptr<double>();
  return {data, data + flat.numel()};
}

/// Axes, sizes and scales out of the inputs and attributes.
std::vector<AxisPlan> plan_axes(const NodeCall& call, const Tensor& x,
                                std::size_t scales_input, std::size_t sizes_input) {
  std::vector<AxisPlan> plans;
  for (const std::int64_t side : x.sizes()) plans.push_back({side, side});
  Sizes axes = call.integers_of("axes");
  if (axes.empty()) {
    axes.resize(plans.size());
    std::iota(axes.begin(), axes.end(), 0);
  }
  for (std::int64_t& axis : axes) axis = call.axis(axis, x.dim());
  std::vector<double> scales, sizes;
  if (call.has(scales_input)) scales = reals(call, scales_input);
  if (scales.empty() && call.has_attribute("scales")) scales = call.attribute("scales").reals;
  if (scales.empty() && sizes_input > 0 && call.has(sizes_input))
    sizes = reals(call, sizes_input);
  if ((scales.empty() ? sizes : scales).size() != axes.size()) {
    call.fail("a scale or a size for each axis",
              std::to_string(scales.size()) + " and " + std::to_string(sizes.size()));
  }
  for (const double value : scales.empty() ? sizes : scales) {
    if (!(value >= 0.0 && value <= static_cast<double>(kMaxElements))) {
      call.fail("scales and sizes from 0 to 2^30", std::to_string(value));
    }
  }
  const std::string policy = call.text_or("keep_aspect_ratio_policy", "stretch");
  if (!sizes.empty() && policy != "stretch") {
    if (policy != "not_larger" && policy != "not_smaller") {
      call.fail("keep_aspect_ratio_policy stretch | not_larger | not_smaller", policy);
    }
    double common = policy == "not_larger" ? 1e300 : 0.0;
    for (std::size_t i = 0; i < axes.size(); ++i) {
      const double ratio =
          sizes[i] / static_cast<double>(plans[static_cast<std::size_t>(axes[i])].input);
      common = policy == "not_larger" ? std::min(common, ratio) : std::max(common, ratio);
    }
    if (!std::isfinite(common)) call.fail("axes with entries", "an empty one");
    for (const std::int64_t axis : axes) {
      AxisPlan& plan = plans[static_cast<std::size_t>(axis)];
      plan.scale = common;
      plan.output = std::llround(common * static_cast<double>(plan.input));
    }
    return plans;
  }
  for (std::size_t i = 0; i < axes.size(); ++i) {
    AxisPlan& plan = plans[static_cast<std::size_t>(axes[i])];
    const double value = scales.empty() ? sizes[i] : scales[i];
    const auto in = static_cast<double>(plan.input);
    plan.scale = scales.empty() ? value / in : value;
    plan.output = static_cast<std::int64_t>(std::floor(scales.empty() ? value : in * value));
  }
  return plans;
}

/// tf_crop_and_resize: input 1 has the starts of all axes, then the ends.
void read_roi(const NodeCall& call, std::vector<AxisPlan>& plans) {
  Sizes axes = call.integers_of("axes");
  if (axes.empty()) {
    axes.resize(plans.size());
    std::iota(axes.begin(), axes.end(), 0);
  }
  const std::vector<double> roi = reals(call, 1);
  if (roi.size() != 2 * axes.size()) {
    call.fail("a start and an end per axis", std::to_string(roi.size()) + " numbers");
  }
  for (std::size_t i = 0; i < axes.size(); ++i) {
    AxisPlan& plan = plans[static_cast<std::size_t>(
        call.axis(axes[i], static_cast<std::int64_t>(plans.size())))];
    plan.roi_start = roi[i];
    plan.roi_end = roi[axes.size() + i];
  }
}

Kernel kernel_of(const NodeCall& call) {
  const std::string mode = call.text_or("mode", "nearest");
  if (mode == "nearest") return Kernel::kNearest;
  if (mode == "linear" || mode == "bilinear") return Kernel::kLinear;
  if (mode == "cubic") return Kernel::kCubic;
  call.fail("mode nearest | linear | cubic", mode);
}

Tensor resample(const NodeCall& call, const Tensor& x, const std::vector<AxisPlan>& plans,
                const std::string& coordinates, const std::string& nearest) {
  Sizes sizes;
  for (const AxisPlan& plan : plans) sizes.push_back(plan.output);
  call.check_size(sizes);
  if (x.numel() == 0 || std::count(sizes.begin(), sizes.end(), 0) > 0) {
    return at::zeros(sizes, x.options());
  }
  ResampleRule rule;
  rule.kernel = kernel_of(call);
  rule.cubic_a = call.real_or("cubic_coeff_a", -0.75);
  rule.exclude_outside = call.attribute_or("exclude_outside", 0) != 0;
  rule.antialias = call.attribute_or("antialias", 0) != 0;
  rule.nearest = nearest_rule(call, nearest);
  const bool crops = coordinates == "tf_crop_and_resize";
  const bool by_float =
      !at::isFloatingType(x.scalar_type()) && rule.kernel != Kernel::kNearest;
  Tensor result = by_float ? x.to(at::kFloat) : x;
  for (std::size_t i = 0; i < plans.size(); ++i) {
    const AxisPlan& plan = plans[i];
    const bool whole = plan.roi_start == 0.0 && plan.roi_end == 1.0;
    if (plan.output == plan.input && plan.scale == 1.0 && whole) continue;
    rule.to_input = coordinate_rule(call, coordinates, plan);
    rule.scale = plan.scale;
    Resampling taps = make_resampling(plan.input, plan.output, rule);
    result = resample_axis(result, static_cast<std::int64_t>(i), taps);
    if (!crops) continue;
    std::vector<float> inside;  // Beyond the image is the extrapolation value.
    for (std::int64_t k = 0; k < plan.output; ++k) {
      const double at = rule.to_input(k);
      inside.push_back(at >= 0.0 && at <= static_cast<double>(plan.input - 1) ? 1.0F : 0.0F);
    }
    Sizes line(plans.size(), 1);
    line[i] = plan.output;
    const Tensor mask =
        at::tensor(at::ArrayRef<float>(inside), at::kFloat).reshape(line).gt(0);
    result =
        at::where(mask, result,
                  at::full({}, call.real_or("extrapolation_value", 0.0), result.options()));
  }
  if (!by_float) return result;
  return at::round(result).to(x.scalar_type());
}

Values resize(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const bool old = call.opset() < 11;  // Opset 10: inputs X, scales.
  std::vector<AxisPlan> plans = plan_axes(call, x, old ? 1 : 2, old ? 0 : 3);
  const std::string coordinates =
      old ? "asymmetric" : call.text_or("coordinate_transformation_mode", "half_pixel");
  if (coordinates == "tf_crop_and_resize") read_roi(call, plans);
  const std::string nearest =
      old ? "floor" : call.text_or("nearest_mode", "round_prefer_floor");
  return {resample(call, x, plans, coordinates, nearest)};
}

Values upsample(const NodeCall& call) {
  const Tensor& x = call.input(0);
  return {resample(call, x, plan_axes(call, x, 1, 0), "asymmetric", "floor")};
}

Values grid_sample(const NodeCall& call) {
  const std::string mode = call.text_or("mode", "bilinear");
  const std::string padding = call.text_or("padding_mode", "zeros");
  const auto one_of = [&](const std::string& word, std::initializer_list<const char*> words) {
    std::int64_t at = 0;
    for (const char* candidate : words) {
      if (word == candidate) return at;
      ++at;
    }
    call.fail("a mode that is supported", word);
  };
  const std::int64_t interpolation = mode == "linear" ? 0
                                     : mode == "cubic"
                                         ? 2
                                         : one_of(mode, {"bilinear", "nearest", "bicubic"});
  return {at::grid_sampler(call.input(0), call.input(1), interpolation,
                           one_of(padding, {"zeros", "border", "reflection"}),
                           call.attribute_or("align_corners", 0) != 0)};
}

constexpr Operator kOperators[] = {
    {"GridSample", 16, kLastOpset, 2, 2, "align_corners mode padding_mode", grid_sample},
    {"Resize", 10, kLastOpset, 2, 4,
     "antialias axes coordinate_transformation_mode cubic_coeff_a exclude_outside "
     "extrapolation_value keep_aspect_ratio_policy mode nearest_mode",
     resize},
    {"Upsample", 7, 9, 1, 2, "mode scales", upsample},
};

}  // namespace

std::span<const Operator> resample_operators() { return kOperators; }

}  // namespace segsim::perception::graph
