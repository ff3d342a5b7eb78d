// Operators that work number by number: arithmetic, comparison, activation, conversion.
#include <cmath>
#include <limits>

#include "perception/models/internal/onnx/onnx_node_call.h"

namespace segsim::perception::graph {
namespace {

using at::Tensor;

template <Tensor (*Function)(const Tensor&)>
Values unary(const NodeCall& call) {
  return {Function(call.input(0))};
}

template <Tensor (*Function)(const Tensor&, const Tensor&)>
Values binary(const NodeCall& call) {
  return {Function(call.input(0), call.input(1))};
}

template <Tensor (*Function)(const Tensor&, const Tensor&)>
Values variadic(const NodeCall& call) {
  Tensor result = call.input(0);
  for (std::size_t i = 1; i < call.input_count(); ++i)
    result = Function(result, call.input(i));
  return {result};
}

bool is_floating(const Tensor& tensor) { return at::isFloatingType(tensor.scalar_type()); }

Tensor add(const Tensor& a, const Tensor& b) { return at::add(a, b); }
Tensor subtract(const Tensor& a, const Tensor& b) { return at::sub(a, b); }
Tensor multiply(const Tensor& a, const Tensor& b) { return at::mul(a, b); }

/// Where integers are -1; of unsigned ones, whose highest would compare equal to it, nowhere.
Tensor is_minus_one(const Tensor& x) {
  if (!at::isSignedType(x.scalar_type())) return at::zeros_like(x, at::kBool);
  return x.eq(-1);
}

/// Integers are divided towards zero. The lowest integer by -1 would trap.
Tensor divide(const Tensor& a, const Tensor& b) {
  if (is_floating(a)) return at::div(a, b);
  const Tensor minus = is_minus_one(b);
  return at::where(minus, at::neg(a),
                   at::div(a, at::where(minus, at::ones_like(b), b), "trunc"));
}

/// The type of the base, whatever that of the exponent is.
Tensor power(const Tensor& base, const Tensor& exponent) {
  if (is_floating(base) || !is_floating(exponent)) {
    if (is_floating(base)) return at::pow(base, exponent.to(base.scalar_type()));
    return at::pow(base.to(at::kDouble), exponent.to(at::kDouble)).to(base.scalar_type());
  }
  return at::pow(base.to(at::kDouble), exponent.to(at::kDouble)).to(base.scalar_type());
}

Tensor equal(const Tensor& a, const Tensor& b) { return at::eq(a, b); }
Tensor greater(const Tensor& a, const Tensor& b) { return at::gt(a, b); }
Tensor less(const Tensor& a, const Tensor& b) { return at::lt(a, b); }
Tensor greater_equal(const Tensor& a, const Tensor& b) { return at::ge(a, b); }
Tensor less_equal(const Tensor& a, const Tensor& b) { return at::le(a, b); }
Tensor logical_and(const Tensor& a, const Tensor& b) { return at::logical_and(a, b); }
Tensor logical_or(const Tensor& a, const Tensor& b) { return at::logical_or(a, b); }
Tensor logical_xor(const Tensor& a, const Tensor& b) { return at::logical_xor(a, b); }
Tensor bitwise_and(const Tensor& a, const Tensor& b) { return at::bitwise_and(a, b); }
Tensor bitwise_or(const Tensor& a, const Tensor& b) { return at::bitwise_or(a, b); }
Tensor bitwise_xor(const Tensor& a, const Tensor& b) { return at::bitwise_xor(a, b); }
Tensor larger(const Tensor& a, const Tensor& b) { return at::maximum(a, b); }
Tensor smaller(const Tensor& a, const Tensor& b) { return at::minimum(a, b); }

Tensor abs(const Tensor& x) { return at::abs(x); }
Tensor negate(const Tensor& x) { return at::neg(x); }
Tensor bitwise_not(const Tensor& x) { return at::bitwise_not(x); }
Tensor sqrt(const Tensor& x) { return at::sqrt(x); }
Tensor exp(const Tensor& x) { return at::exp(x); }
Tensor log(const Tensor& x) { return at::log(x); }
Tensor erf(const Tensor& x) { return at::erf(x); }
Tensor sin(const Tensor& x) { return at::sin(x); }
Tensor cos(const Tensor& x) { return at::cos(x); }
Tensor tan(const Tensor& x) { return at::tan(x); }
Tensor asin(const Tensor& x) { return at::asin(x); }
Tensor acos(const Tensor& x) { return at::acos(x); }
Tensor atan(const Tensor& x) { return at::atan(x); }
Tensor sinh(const Tensor& x) { return at::sinh(x); }
Tensor cosh(const Tensor& x) { return at::cosh(x); }
Tensor asinh(const Tensor& x) { return at::asinh(x); }
Tensor acosh(const Tensor& x) { return at::acosh(x); }
Tensor atanh(const Tensor& x) { return at::atanh(x); }
Tensor tanh(const Tensor& x) { return at::tanh(x); }
Tensor sign(const Tensor& x) { return at::sign(x); }
Tensor reciprocal(const Tensor& x) { return at::reciprocal(x); }
Tensor sigmoid(const Tensor& x) { return at::sigmoid(x); }
Tensor relu(const Tensor& x) { return at::relu(x); }
Tensor soft_plus(const Tensor& x) {  // at::softplus() is linear above 20.
  return at::log1p(at::exp(at::neg(at::abs(x)))) + at::relu(x);
}
Tensor softsign(const Tensor& x) { return x / (at::abs(x) + 1); }
Tensor mish(const Tensor& x) { return x * at::tanh(soft_plus(x)); }
Tensor hard_swish(const Tensor& x) { return at::hardswish(x); }
Tensor logical_not(const Tensor& x) { return at::logical_not(x); }
Tensor is_nan(const Tensor& x) { return at::isnan(x); }
Tensor floor(const Tensor& x) { return is_floating(x) ? at::floor(x) : x; }
Tensor ceil(const Tensor& x) { return is_floating(x) ? at::ceil(x) : x; }
Tensor round(const Tensor& x) { return is_floating(x) ? at::round(x) : x; }  // Half to even.

Values mean(const NodeCall& call) {
  const Values sum = variadic<add>(call);
  return {at::div(sum[0].tensor, static_cast<double>(call.input_count()))};
}

/// fmod 0: the sign of the divisor; 1: of the dividend.
Values modulo(const NodeCall& call) {
  const Tensor &a = call.input(0), &b = call.input(1);
  const bool like_c = call.attribute_or("fmod", 0) != 0;
  if (is_floating(a) && !like_c) call.fail("fmod = 1 for floating numbers", "0");
  if (is_floating(a)) return {at::fmod(a, b)};
  const Tensor safe =
      at::where(is_minus_one(b), at::ones_like(b), b);  // Remainder 0 either way.
  return {like_c ? at::fmod(a, safe) : at::remainder(a, safe)};
}

Values bit_shift(const NodeCall& call) {
  const std::string direction = call.text_or("direction", "");
  if (direction != "LEFT" && direction != "RIGHT") {
    call.fail("direction LEFT | RIGHT", "'" + direction + "'");
  }
  const Tensor &a = call.input(0), &b = call.input(1);
  return {direction == "LEFT" ? at::bitwise_left_shift(a, b) : at::bitwise_right_shift(a, b)};
}

Values leaky_relu(const NodeCall& call) {
  return {at::leaky_relu(call.input(0), call.real_or("alpha", 0.01))};
}
Values elu(const NodeCall& call) {
  return {at::elu(call.input(0), call.real_or("alpha", 1.0))};
}
Values selu(const NodeCall& call) {
  const double alpha = call.real_or("alpha", 1.67326319217681884765625);
  return {at::elu(call.input(0), alpha, call.real_or("gamma", 1.05070102214813232421875))};
}
Values celu(const NodeCall& call) {
  return {at::celu(call.input(0), call.real_or("alpha", 1.0))};
}
Values hard_sigmoid(const NodeCall& call) {
  const Tensor line = call.input(0) * call.real_or("alpha", 0.2F) + call.real_or("beta", 0.5);
  return {at::clamp(line, 0, 1)};
}
Values thresholded_relu(const NodeCall& call) {
  const Tensor& x = call.input(0);
  return {at::where(x > call.real_or("alpha", 1.0), x, at::zeros_like(x))};
}
Values shrink(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const double lambda = call.real_or("lambd", 0.5), bias = call.real_or("bias", 0.0);
  const Tensor zero = at::zeros_like(x);
  return {at::where(x < -lambda, x + bias, at::where(x > lambda, x - bias, zero))};
}
Values gelu(const NodeCall& call) {
  return {at::gelu(call.input(0), call.text_or("approximate", "none"))};
}
Values prelu(const NodeCall& call) {
  const Tensor& x = call.input(0);
  return {at::where(x < 0, x * call.input(1), x)};
}

Values is_infinite(const NodeCall& call) {
  const Tensor& x = call.input(0);
  Tensor result = at::zeros_like(x, at::kBool);
  const double infinity = std::numeric_limits<double>::infinity();
  if (call.attribute_or("detect_positive", 1) != 0) result = result | x.eq(infinity);
  if (call.attribute_or("detect_negative", 1) != 0) result = result | x.eq(-infinity);
  return {result};
}

/// Bounds are attributes before opset 11, inputs since.
Values clip(const NodeCall& call) {
  Tensor x = call.input(0);
  if (call.has_attribute("min")) x = at::clamp_min(x, call.attribute("min").real);
  if (call.has_attribute("max")) x = at::clamp_max(x, call.attribute("max").real);
  if (call.has(1)) x = at::maximum(x, call.input(1));
  if (call.has(2)) x = at::minimum(x, call.input(2));
  return {x};
}

Values where(const NodeCall& call) {
  return {at::where(call.input(0).to(at::kBool), call.input(1), call.input(2))};
}

/// float16 and bfloat16 are computed as float, but a conversion rounds.
Values cast(const NodeCall& call) {
  constexpr std::int64_t kFloat16 = 10, kBfloat16 = 16;  // Of TensorProto.
  const std::int64_t to = call.attribute("to").integer;
  if (to == kFloat16 || to == kBfloat16) {
    return {call.input(0).to(to == kFloat16 ? at::kHalf : at::kBFloat16).to(at::kFloat)};
  }
  return {call.input(0).to(type_of(call, call.attribute("to").integer))};
}
Values cast_like(const NodeCall& call) {
  return {call.input(0).to(call.input(1).scalar_type())};
}

Values identity(const NodeCall& call) { return {call.value(0)}; }

/// Nothing is dropped at inference.
Values dropout(const NodeCall& call) {
  if (call.has(2) && call.integer(2) != 0) call.fail("inference", "training_mode");
  return {call.input(0), at::ones_like(call.input(0), at::kBool)};
}

constexpr Operator kOperators[] = {
    {"Abs", 6, kLastOpset, 1, 1, "", unary<abs>},
    {"Acos", 7, kLastOpset, 1, 1, "", unary<acos>},
    {"Acosh", 9, kLastOpset, 1, 1, "", unary<acosh>},
    {"Add", 7, kLastOpset, 2, 2, "", binary<add>},
    {"And", 7, kLastOpset, 2, 2, "", binary<logical_and>},
    {"Asin", 7, kLastOpset, 1, 1, "", unary<asin>},
    {"Asinh", 9, kLastOpset, 1, 1, "", unary<asinh>},
    {"Atan", 7, kLastOpset, 1, 1, "", unary<atan>},
    {"Atanh", 9, kLastOpset, 1, 1, "", unary<atanh>},
    {"BitShift", 11, kLastOpset, 2, 2, "direction", bit_shift},
    {"BitwiseAnd", 18, kLastOpset, 2, 2, "", binary<bitwise_and>},
    {"BitwiseNot", 18, kLastOpset, 1, 1, "", unary<bitwise_not>},
    {"BitwiseOr", 18, kLastOpset, 2, 2, "", binary<bitwise_or>},
    {"BitwiseXor", 18, kLastOpset, 2, 2, "", binary<bitwise_xor>},
    {"Cast", 6, kLastOpset, 1, 1, "to saturate", cast},
    {"CastLike", 15, kLastOpset, 2, 2, "saturate", cast_like},
    {"Ceil", 6, kLastOpset, 1, 1, "", unary<ceil>},
    {"Celu", 12, kLastOpset, 1, 1, "alpha", celu},
    {"Clip", 6, kLastOpset, 1, 3, "min max", clip},
    {"Cos", 7, kLastOpset, 1, 1, "", unary<cos>},
    {"Cosh", 9, kLastOpset, 1, 1, "", unary<cosh>},
    {"Div", 7, kLastOpset, 2, 2, "", binary<divide>},
    {"Dropout", 7, kLastOpset, 1, 3, "ratio seed", dropout},
    {"Elu", 6, kLastOpset, 1, 1, "alpha", elu},
    {"Equal", 7, kLastOpset, 2, 2, "", binary<equal>},
    {"Erf", 9, kLastOpset, 1, 1, "", unary<erf>},
    {"Exp", 6, kLastOpset, 1, 1, "", unary<exp>},
    {"Floor", 6, kLastOpset, 1, 1, "", unary<floor>},
    {"Gelu", 20, kLastOpset, 1, 1, "approximate", gelu},
    {"Greater", 7, kLastOpset, 2, 2, "", binary<greater>},
    {"GreaterOrEqual", 12, kLastOpset, 2, 2, "", binary<greater_equal>},
    {"HardSigmoid", 6, kLastOpset, 1, 1, "alpha beta", hard_sigmoid},
    {"HardSwish", 14, kLastOpset, 1, 1, "", unary<hard_swish>},
    {"Identity", 1, kLastOpset, 1, 1, "", identity},
    {"IsInf", 10, kLastOpset, 1, 1, "detect_negative detect_positive", is_infinite},
    {"IsNaN", 9, kLastOpset, 1, 1, "", unary<is_nan>},
    {"LeakyRelu", 6, kLastOpset, 1, 1, "alpha", leaky_relu},
    {"Less", 7, kLastOpset, 2, 2, "", binary<less>},
    {"LessOrEqual", 12, kLastOpset, 2, 2, "", binary<less_equal>},
    {"Log", 6, kLastOpset, 1, 1, "", unary<log>},
    {"Max", 6, kLastOpset, 1, -1, "", variadic<larger>},
    {"Mean", 6, kLastOpset, 1, -1, "", mean},
    {"Min", 6, kLastOpset, 1, -1, "", variadic<smaller>},
    {"Mish", 18, kLastOpset, 1, 1, "", unary<mish>},
    {"Mod", 10, kLastOpset, 2, 2, "fmod", modulo},
    {"Mul", 7, kLastOpset, 2, 2, "", binary<multiply>},
    {"Neg", 6, kLastOpset, 1, 1, "", unary<negate>},
    {"Not", 1, kLastOpset, 1, 1, "", unary<logical_not>},
    {"Or", 7, kLastOpset, 2, 2, "", binary<logical_or>},
    {"PRelu", 7, kLastOpset, 2, 2, "", prelu},
    {"Pow", 7, kLastOpset, 2, 2, "", binary<power>},
    {"Reciprocal", 6, kLastOpset, 1, 1, "", unary<reciprocal>},
    {"Relu", 6, kLastOpset, 1, 1, "", unary<relu>},
    {"Round", 11, kLastOpset, 1, 1, "", unary<round>},
    {"Selu", 6, kLastOpset, 1, 1, "alpha gamma", selu},
    {"Shrink", 9, kLastOpset, 1, 1, "lambd bias", shrink},
    {"Sigmoid", 6, kLastOpset, 1, 1, "", unary<sigmoid>},
    {"Sign", 9, kLastOpset, 1, 1, "", unary<sign>},
    {"Sin", 7, kLastOpset, 1, 1, "", unary<sin>},
    {"Sinh", 9, kLastOpset, 1, 1, "", unary<sinh>},
    {"Softplus", 1, kLastOpset, 1, 1, "", unary<soft_plus>},
    {"Softsign", 1, kLastOpset, 1, 1, "", unary<softsign>},
    {"Sqrt", 6, kLastOpset, 1, 1, "", unary<sqrt>},
    {"Sub", 7, kLastOpset, 2, 2, "", binary<subtract>},
    {"Sum", 6, kLastOpset, 1, -1, "", variadic<add>},
    {"Tan", 7, kLastOpset, 1, 1, "", unary<tan>},
    {"Tanh", 6, kLastOpset, 1, 1, "", unary<tanh>},
    {"ThresholdedRelu", 10, kLastOpset, 1, 1, "alpha", thresholded_relu},
    {"Where", 9, kLastOpset, 3, 3, "", where},
    {"Xor", 7, kLastOpset, 2, 2, "", binary<logical_xor>},
};

}  // namespace

std::span<const Operator> elementwise_operators() { return kOperators; }

}  // namespace segsim::perception::graph
