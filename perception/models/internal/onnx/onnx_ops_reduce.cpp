// Operators that sum up axes.
#include <numeric>

#include "perception/models/internal/onnx/onnx_node_call.h"

namespace segsim::perception::graph {
namespace {

using at::Tensor;
using Sizes = std::vector<std::int64_t>;

/// Floating numbers as they are, integers as double.
Tensor floating(const Tensor& x) {
  return at::isFloatingType(x.scalar_type()) ? x : x.to(at::kDouble);
}

Tensor sum(const Tensor& x, const Sizes& axes) {
  return at::sum(x, axes, true, x.scalar_type());
}
Tensor mean(const Tensor& x, const Sizes& axes) { return at::mean(floating(x), axes, true); }
Tensor largest(const Tensor& x, const Sizes& axes) { return at::amax(x, axes, true); }
Tensor smallest(const Tensor& x, const Sizes& axes) { return at::amin(x, axes, true); }
Tensor product(const Tensor& x, const Sizes& axes) {
  Tensor result = x;
  for (const std::int64_t axis : axes) result = at::prod(result, axis, true, x.scalar_type());
  return result;
}
Tensor absolute_sum(const Tensor& x, const Sizes& axes) { return sum(at::abs(x), axes); }
Tensor square_sum(const Tensor& x, const Sizes& axes) { return sum(x * x, axes); }
Tensor length(const Tensor& x, const Sizes& axes) {
  return at::sqrt(square_sum(floating(x), axes));
}
Tensor log_sum(const Tensor& x, const Sizes& axes) { return at::log(sum(floating(x), axes)); }
Tensor log_sum_exp(const Tensor& x, const Sizes& axes) {
  return at::logsumexp(floating(x), axes, true);
}

/// Axes are an attribute in older opsets, an input in newer ones; none means all.
template <Tensor (*Function)(const Tensor&, const Sizes&)>
Values reduce(const NodeCall& call) {
  const Tensor& x = call.input(0);
  Sizes axes = call.axes(call.has(1) ? call.integers(1) : call.integers_of("axes"), x.dim());
  if (axes.empty()) {
    if (call.attribute_or("noop_with_empty_axes", 0) != 0) return {x};
    axes.resize(static_cast<std::size_t>(x.dim()));
    std::iota(axes.begin(), axes.end(), 0);
  }
  Tensor result = axes.empty() ? Function(x.reshape({1}), {0}).reshape({}) : Function(x, axes);
  result = result.to(x.scalar_type());
  if (call.attribute_or("keepdims", 1) == 0) {
    for (auto axis = axes.rbegin(); axis != axes.rend(); ++axis)
      result = result.squeeze(*axis);
  }
  return {result};
}

template <bool kLargest>
Values arg_best(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::int64_t axis = call.axis(call.attribute_or("axis", 0), x.dim());
  const bool keep = call.attribute_or("keepdims", 1) != 0;
  const auto find = [&](const Tensor& values) {
    return kLargest ? at::argmax(values, axis, keep) : at::argmin(values, axis, keep);
  };
  if (call.attribute_or("select_last_index", 0) == 0) return {find(x)};
  return {x.size(axis) - 1 - find(at::flip(x, {axis}))};
}

Values cumulative_sum(const NodeCall& call) {
  Tensor x = call.input(0);
  const std::int64_t axis = call.axis(call.integer(1), x.dim());
  const bool reverse = call.attribute_or("reverse", 0) != 0;
  if (reverse) x = at::flip(x, {axis});
  Tensor sums = at::cumsum(x, axis, x.scalar_type());
  if (call.attribute_or("exclusive", 0) != 0 && x.size(axis) > 0) {
    sums = at::cat(
        {at::zeros_like(x.slice(axis, 0, 1)), sums.slice(axis, 0, x.size(axis) - 1)}, axis);
  }
  return {reverse ? at::flip(sums, {axis}) : sums};
}

constexpr const char* kReduce = "axes keepdims noop_with_empty_axes";
constexpr Operator kOperators[] = {
    {"ArgMax", 1, kLastOpset, 1, 1, "axis keepdims select_last_index", arg_best<true>},
    {"ArgMin", 1, kLastOpset, 1, 1, "axis keepdims select_last_index", arg_best<false>},
    {"CumSum", 11, kLastOpset, 2, 2, "exclusive reverse", cumulative_sum},
    {"ReduceL1", 1, kLastOpset, 1, 2, kReduce, reduce<absolute_sum>},
    {"ReduceL2", 1, kLastOpset, 1, 2, kReduce, reduce<length>},
    {"ReduceLogSum", 1, kLastOpset, 1, 2, kReduce, reduce<log_sum>},
    {"ReduceLogSumExp", 1, kLastOpset, 1, 2, kReduce, reduce<log_sum_exp>},
    {"ReduceMax", 1, kLastOpset, 1, 2, kReduce, reduce<largest>},
    {"ReduceMean", 1, kLastOpset, 1, 2, kReduce, reduce<mean>},
    {"ReduceMin", 1, kLastOpset, 1, 2, kReduce, reduce<smallest>},
    {"ReduceProd", 1, kLastOpset, 1, 2, kReduce, reduce<product>},
    {"ReduceSum", 1, kLastOpset, 1, 2, kReduce, reduce<sum>},
    {"ReduceSumSquare", 1, kLastOpset, 1, 2, kReduce, reduce<square_sum>},
};

}  // namespace

std::span<const Operator> reduce_operators() { return kOperators; }

}  // namespace segsim::perception::graph
