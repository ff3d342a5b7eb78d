// Products of matrices, and the linear quantisation around them.
#include <algorithm>

#include "perception/models/internal/onnx/onnx_node_call.h"

namespace segsim::perception::graph {
namespace {

using at::Tensor;

Values matmul(const NodeCall& call) { return {at::matmul(call.input(0), call.input(1))}; }

Values gemm(const NodeCall& call) {
  const auto matrix = [&](std::size_t i, const char* transposed) {
    const Tensor& m = call.input(i);
    if (m.dim() != 2) call.fail("a matrix", shape_text(m.sizes().vec()));
    return call.attribute_or(transposed, 0) != 0 ? m.t() : m;
  };
  const double alpha = call.real_or("alpha", 1.0), beta = call.real_or("beta", 1.0);
  Tensor product = at::matmul(matrix(0, "transA"), matrix(1, "transB"));
  if (alpha != 1.0) product = product * alpha;
  if (!call.has(2)) return {product};
  return {product + (beta == 1.0 ? call.input(2) : call.input(2) * beta)};
}

Values einsum(const NodeCall& call) {
  std::string equation = call.text_or("equation", "");
  std::erase(equation, ' ');
  return {at::einsum(equation, call.tensors())};
}

/// Scale or zero point along `axis`, where it has one number per place.
Tensor along(const NodeCall& call, const Tensor& values, const Tensor& x) {
  if (values.numel() == 1) return values.reshape({});
  const std::int64_t axis = call.axis(call.attribute_or("axis", 1), x.dim());
  if (values.dim() != 1 || values.numel() != x.size(axis)) {
    call.fail("one scale, or one per place of the axis", shape_text(values.sizes().vec()));
  }
  std::vector<std::int64_t> line(static_cast<std::size_t>(x.dim()), 1);
  line[static_cast<std::size_t>(axis)] = values.numel();
  return values.reshape(line);
}

Values dequantize(const NodeCall& call) {
  const Tensor& x = call.input(0);
  Tensor wide = x.to(at::kInt);
  if (call.has(2)) wide = wide - along(call, call.input(2), x).to(at::kInt);
  return {wide.to(at::kFloat) * along(call, call.input(1), x)};
}

struct Range {
  double low, high;
};

Range range_of(const NodeCall& call, at::ScalarType type) {
  if (type == at::kByte) return {0, 255};
  if (type == at::kChar) return {-128, 127};
  call.fail("int8 or uint8", at::toString(type));
}

Values quantize(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const auto type = call.has(2) ? call.input(2).scalar_type() : at::kByte;
  const Range range = range_of(call, type);
  Tensor steps = at::round(x / along(call, call.input(1), x));
  if (call.has(2)) steps = steps + along(call, call.input(2), x).to(at::kFloat);
  return {at::clamp(steps, range.low, range.high).to(type)};
}

Values quantize_dynamically(const NodeCall& call) {
  const Tensor& x = call.input(0);
  if (x.numel() == 0) call.fail("numbers", "an empty tensor");
  const Tensor high = at::clamp_min(x.max(), 0), low = at::clamp_max(x.min(), 0);
  const Tensor scale = (high - low) / 255;
  const Tensor zero = at::clamp(at::round(-low / scale), 0, 255);
  return {at::clamp(at::round(x / scale) + zero, 0, 255).to(at::kByte), scale,
          zero.to(at::kByte)};
}

/// Sums of products of 8-bit integers are exact in double.
Tensor without_zero(const NodeCall& call, std::size_t i, std::size_t zero, bool rows) {
  Tensor wide = call.input(i).to(at::kDouble);
  if (!call.has(zero)) return wide;
  const Tensor offset = call.input(zero).to(at::kDouble);
  if (offset.numel() == 1) return wide - offset.reshape({});
  return wide - (rows ? offset.unsqueeze(-1) : offset);
}

Values matmul_integer(const NodeCall& call) {
  return {at::matmul(without_zero(call, 0, 2, true), without_zero(call, 1, 3, false))
              .to(at::kInt)};
}

constexpr Operator kOperators[] = {
    {"DequantizeLinear", 10, 20, 2, 3, "axis", dequantize},
    {"DynamicQuantizeLinear", 11, kLastOpset, 1, 1, "", quantize_dynamically},
    {"Einsum", 12, kLastOpset, 1, -1, "equation", einsum},
    {"Gemm", 7, kLastOpset, 2, 3, "alpha beta transA transB", gemm},
    {"MatMul", 1, kLastOpset, 2, 2, "", matmul},
    {"MatMulInteger", 10, kLastOpset, 2, 4, "", matmul_integer},
    {"QuantizeLinear", 10, 20, 2, 3, "axis saturate", quantize},
};

}  // namespace

std::span<const Operator> matrix_operators() { return kOperators; }

}  // namespace segsim::perception::graph
