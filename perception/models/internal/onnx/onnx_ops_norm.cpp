// Normalisations and softmax.
#include <algorithm>
#include <numeric>

#include "perception/models/internal/onnx/onnx_node_call.h"

namespace segsim::perception::graph {
namespace {

using at::Tensor;
using Sizes = std::vector<std::int64_t>;

/// One number per channel, for [batch, channels, ...].
Tensor per_channel(const NodeCall& call, const Tensor& values, const Tensor& x) {
  if (x.dim() < 2 || values.numel() != x.size(1)) {
    call.fail("one number per channel of " + shape_text(x.sizes().vec()),
              std::to_string(values.numel()));
  }
  Sizes line(static_cast<std::size_t>(x.dim()), 1);
  line[1] = x.size(1);
  return values.reshape(line);
}

Values batch_normalization(const NodeCall& call) {
  const Tensor& x = call.input(0);
  if (call.attribute_or("training_mode", 0) != 0 || call.attribute_or("spatial", 1) == 0 ||
      call.wants(1)) {
    call.fail("inference per channel", "training or another layout");
  }
  const Tensor scale =
      call.input(1) / at::sqrt(call.input(4) + call.real_or("epsilon", 1e-5F));
  const Tensor shift = call.input(2) - call.input(3) * scale;
  return {x * per_channel(call, scale, x) + per_channel(call, shift, x)};
}

/// (x - mean) / sqrt(variance + epsilon) over `axes`.
Tensor standardized(const Tensor& x, const Sizes& axes, double epsilon) {
  const Tensor centred = x - at::mean(x, axes, true);
  return centred * at::rsqrt(at::mean(centred * centred, axes, true) + epsilon);
}

Sizes axes_from(std::int64_t first, std::int64_t rank) {
  Sizes axes(static_cast<std::size_t>(std::max<std::int64_t>(rank - first, 0)));
  std::iota(axes.begin(), axes.end(), first);
  return axes;
}

Values instance_normalization(const NodeCall& call) {
  const Tensor& x = call.input(0);
  if (x.dim() < 3) call.fail("spatial axes", shape_text(x.sizes().vec()));
  const Tensor unit = standardized(x, axes_from(2, x.dim()), call.real_or("epsilon", 1e-5F));
  return {unit * per_channel(call, call.input(1), x) + per_channel(call, call.input(2), x)};
}

Values layer_normalization(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::int64_t axis = call.axis(call.attribute_or("axis", -1), x.dim());
  const double epsilon = call.real_or("epsilon", 1e-5F);
  const at::IntArrayRef sides = x.sizes().slice(static_cast<std::size_t>(axis));
  const Tensor& scale = call.input(1);
  const bool plain =
      scale.sizes() == sides && (!call.has(2) || call.input(2).sizes() == sides);
  if (plain && !call.wants(1) && !call.wants(2)) {
    return {at::layer_norm(x, sides, scale, call.optional_input(2), epsilon)};
  }
  const Sizes axes = axes_from(axis, x.dim());
  const Tensor mean = at::mean(x, axes, true), centred = x - mean;
  const Tensor inverse = at::rsqrt(at::mean(centred * centred, axes, true) + epsilon);
  Tensor y = centred * inverse * scale;
  if (call.has(2)) y = y + call.input(2);
  return {y, mean, inverse};
}

/// Scale and bias are per group in opset 18, per channel since 21.
Values group_normalization(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::int64_t groups = call.attribute("num_groups").integer;
  if (x.dim() < 2 || groups < 1 || x.size(1) % groups != 0) {
    call.fail("groups that divide the channels of " + shape_text(x.sizes().vec()),
              std::to_string(groups));
  }
  const std::int64_t each = x.size(1) / groups;
  const auto spread = [&](const Tensor& values) {
    const bool per_group = values.numel() == groups && groups != x.size(1);
    return per_channel(call, per_group ? values.repeat_interleave(each) : values, x);
  };
  const Tensor unit =
      standardized(x.reshape({x.size(0), groups, -1}), {2}, call.real_or("epsilon", 1e-5F))
          .reshape(x.sizes());
  return {unit * spread(call.input(1)) + spread(call.input(2))};
}

Values lp_normalization(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::int64_t axis = call.axis(call.attribute_or("axis", -1), x.dim());
  const std::int64_t p = call.attribute_or("p", 2);
  if (p != 1 && p != 2) call.fail("p 1 | 2", std::to_string(p));
  const Tensor length =
      p == 1 ? at::sum(at::abs(x), {axis}, true) : at::sqrt(at::sum(x * x, {axis}, true));
  return {at::where(length.eq(0), at::zeros_like(x), x / length)};
}

Values local_response(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::int64_t size = call.attribute("size").integer;
  if (x.dim() < 3 || size < 1 || size > kMaxElements) {
    call.fail("an image and a size from 1", std::to_string(size));
  }
  const std::int64_t before = (size - 1) / 2, after = size - 1 - before, n = x.size(1);
  const Tensor squares = x * x;
  Tensor sum = at::zeros_like(x);
  for (std::int64_t shift = std::max(-before, -n); shift <= std::min(after, n); ++shift) {
    const std::int64_t from = std::max<std::int64_t>(0, -shift);
    const std::int64_t to = std::min(n, n - shift);
    if (from >= to) continue;
    sum.slice(1, from, to) += squares.slice(1, from + shift, to + shift);
  }
  const double alpha = call.real_or("alpha", 1e-4F), bias = call.real_or("bias", 1.0);
  return {x /
          at::pow(bias + alpha / static_cast<double>(size) * sum, call.real_or("beta", 0.75))};
}

Values mean_variance(const NodeCall& call) {
  const Tensor& x = call.input(0);
  Sizes axes = call.integers_of("axes");
  if (axes.empty()) axes = {0, 2, 3};
  axes = call.axes(axes, x.dim());
  const Tensor centred = x - at::mean(x, axes, true);
  return {centred / (at::sqrt(at::mean(centred * centred, axes, true)) + 1e-9)};
}

/// Before opset 13 all axes from `axis` on count as one.
template <Tensor (*Function)(const Tensor&, std::int64_t)>
Values along_axis(const NodeCall& call) {
  const Tensor& x = call.input(0);
  if (call.opset() >= 13) {
    return {Function(x, call.axis(call.attribute_or("axis", -1), x.dim()))};
  }
  const std::int64_t axis = call.axis(call.attribute_or("axis", 1), x.dim());
  if (axis == x.dim() - 1) return {Function(x, axis)};
  Sizes flat(x.sizes().begin(), x.sizes().begin() + axis);
  flat.push_back(-1);
  return {Function(x.reshape(flat), axis).reshape(x.sizes())};
}

Tensor softmax(const Tensor& x, std::int64_t axis) { return at::softmax(x, axis); }
Tensor log_softmax(const Tensor& x, std::int64_t axis) { return at::log_softmax(x, axis); }
Tensor hardmax(const Tensor& x, std::int64_t axis) {
  return at::zeros_like(x).scatter(axis, at::argmax(x, axis, true), 1);
}

constexpr Operator kOperators[] = {
    {"BatchNormalization", 7, kLastOpset, 5, 5, "epsilon momentum spatial training_mode",
     batch_normalization},
    {"GroupNormalization", 18, kLastOpset, 3, 3, "epsilon num_groups stash_type",
     group_normalization},
    {"Hardmax", 1, kLastOpset, 1, 1, "axis", along_axis<hardmax>},
    {"InstanceNormalization", 6, kLastOpset, 3, 3, "epsilon", instance_normalization},
    {"LRN", 1, kLastOpset, 1, 1, "alpha beta bias size", local_response},
    {"LayerNormalization", 17, kLastOpset, 2, 3, "axis epsilon stash_type",
     layer_normalization},
    {"LogSoftmax", 1, kLastOpset, 1, 1, "axis", along_axis<log_softmax>},
    {"LpNormalization", 1, kLastOpset, 1, 1, "axis p", lp_normalization},
    {"MeanVarianceNormalization", 9, kLastOpset, 1, 1, "axes", mean_variance},
    {"Softmax", 1, kLastOpset, 1, 1, "axis", along_axis<softmax>},
};

}  // namespace

std::span<const Operator> norm_operators() { return kOperators; }

}  // namespace segsim::perception::graph
