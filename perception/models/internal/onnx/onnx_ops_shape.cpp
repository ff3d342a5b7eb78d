// Operators that move, cut and join numbers without computing with them.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "perception/models/internal/onnx/onnx_node_call.h"

namespace segsim::perception::graph {
namespace {

using at::Tensor;
using Sizes = std::vector<std::int64_t>;

Sizes sizes_of(const Tensor& tensor) { return tensor.sizes().vec(); }

Tensor from_integers(const Sizes& values) {
  return at::tensor(at::ArrayRef<std::int64_t>(values), at::kLong);
}

Values shape(const NodeCall& call) {
  const Sizes sizes = sizes_of(call.input(0));
  const auto rank = static_cast<std::int64_t>(sizes.size());
  const auto bound = [&](const char* name, std::int64_t fallback) {
    const std::int64_t at = call.attribute_or(name, fallback);
    return std::clamp<std::int64_t>(at < 0 ? at + rank : at, 0, rank);
  };
  const std::int64_t start = bound("start", 0), end = std::max(start, bound("end", rank));
  return {from_integers({sizes.begin() + start, sizes.begin() + end})};
}

Values size(const NodeCall& call) {
  return {at::scalar_tensor(call.input(0).numel(), at::kLong)};
}

Values reshape(const NodeCall& call) {
  const Tensor& x = call.input(0);
  Sizes sizes = call.integers(1);
  const bool copies = call.attribute_or("allowzero", 0) == 0;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    if (sizes[i] == 0 && copies && i < static_cast<std::size_t>(x.dim())) {
      sizes[i] = x.size(static_cast<std::int64_t>(i));
    }
  }
  return {at::reshape(x, sizes)};
}

Values flatten(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::int64_t raw = call.attribute_or("axis", 1);
  const std::int64_t axis = raw == x.dim() ? raw : call.axis(raw, x.dim());
  std::int64_t rows = 1;
  for (std::int64_t i = 0; i < axis; ++i) rows *= x.size(i);
  return {at::reshape(x, {rows, rows == 0 ? 0 : x.numel() / rows})};
}

/// Axes are an attribute before opset 13, an input since.
Sizes axes_of(const NodeCall& call) {
  return call.has(1) ? call.integers(1) : call.integers_of("axes");
}

Values squeeze(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const bool all = !call.has(1) && !call.has_attribute("axes");
  const Sizes axes = call.axes(axes_of(call), x.dim());
  Sizes sizes;
  for (std::int64_t i = 0; i < x.dim(); ++i) {
    const bool named = std::binary_search(axes.begin(), axes.end(), i);
    if (named && x.size(i) != 1) {
      call.fail("a side of 1 along axis " + std::to_string(i), shape_text(sizes_of(x)));
    }
    if (!(named || (all && x.size(i) == 1))) sizes.push_back(x.size(i));
  }
  return {at::reshape(x, sizes)};
}

Values unsqueeze(const NodeCall& call) {
  const Tensor& x = call.input(0);
  Sizes axes = axes_of(call);
  axes = call.axes(axes, x.dim() + static_cast<std::int64_t>(axes.size()));
  Sizes sizes = sizes_of(x);
  for (const std::int64_t axis : axes) sizes.insert(sizes.begin() + axis, 1);
  return {at::reshape(x, sizes)};
}

Values transpose(const NodeCall& call) {
  const Tensor& x = call.input(0);
  Sizes order = call.integers_of("perm");
  if (order.empty()) {
    order.resize(static_cast<std::size_t>(x.dim()));
    std::iota(order.rbegin(), order.rend(), 0);
  }
  return {x.permute(order)};
}

Values concat(const NodeCall& call) {
  const std::vector<Tensor> parts = call.tensors();
  return {at::cat(parts, call.axis(call.attribute("axis").integer, parts[0].dim()))};
}

Values split(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::int64_t axis = call.axis(call.attribute_or("axis", 0), x.dim());
  Sizes sizes = call.has(1) ? call.integers(1) : call.integers_of("split");
  if (sizes.empty()) {
    const auto parts =
        call.attribute_or("num_outputs", static_cast<std::int64_t>(call.output_count()));
    if (parts < 1 || parts > kMaxElements)
      call.fail("at least one part", std::to_string(parts));
    const std::int64_t each = (x.size(axis) + parts - 1) / parts;
    for (std::int64_t i = 0; i < parts; ++i) {
      sizes.push_back(std::clamp<std::int64_t>(x.size(axis) - i * each, 0, each));
    }
  }
  Values parts;
  for (const Tensor& part : at::split_with_sizes(x, sizes, axis)) parts.emplace_back(part);
  return parts;
}

/// One axis of Slice, with the standard's clamping.
Tensor slice_axis(const Tensor& x, std::int64_t axis, std::int64_t start, std::int64_t end,
                  std::int64_t step) {
  const std::int64_t n = x.size(axis);
  const auto wrap = [n](std::int64_t at) { return at < 0 ? std::max(at, -n - 1) + n : at; };
  if (step > 0) {
    const std::int64_t from = std::clamp<std::int64_t>(wrap(start), 0, n);
    const std::int64_t to = std::clamp<std::int64_t>(wrap(end), from, n);
    return at::slice(x, axis, from, to, step);
  }
  Sizes picked;
  const std::int64_t from = std::min(wrap(start), n - 1);
  const std::int64_t to = std::max<std::int64_t>(end < 0 ? wrap(end) : std::min(end, n), -1);
  for (std::int64_t i = from; i > to; i += std::max(step, -n - 1)) picked.push_back(i);
  return at::index_select(x, axis, from_integers(picked));
}

Values slice(const NodeCall& call) {
  Tensor x = call.input(0);
  const bool by_input = call.opset() >= 10;
  const Sizes starts = by_input ? call.integers(1) : call.integers_of("starts");
  const Sizes ends = by_input ? call.integers(2) : call.integers_of("ends");
  Sizes axes = call.has(3) ? call.integers(3) : call.integers_of("axes");
  if (axes.empty()) {
    axes.resize(starts.size());
    std::iota(axes.begin(), axes.end(), 0);
  }
  const Sizes steps = call.has(4) ? call.integers(4) : Sizes(starts.size(), 1);
  if (starts.size() != ends.size() || starts.size() != axes.size() ||
      starts.size() != steps.size()) {
    call.fail("as many starts as ends, axes and steps", std::to_string(starts.size()));
  }
  for (std::size_t i = 0; i < starts.size(); ++i) {
    if (steps[i] == 0) call.fail("steps other than 0", "0");
    x = slice_axis(x, call.axis(axes[i], x.dim()), starts[i], ends[i], steps[i]);
  }
  return {x};
}

Values expand(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const Sizes wanted = call.integers(1);
  call.check_size(wanted);
  const Sizes sizes = at::infer_size(x.sizes(), wanted);
  call.check_size(sizes);
  return {x.expand(sizes)};
}

Values tile(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const Sizes repeats = call.integers(1);
  call.check_size(repeats);
  Sizes sizes = sizes_of(x);
  if (repeats.size() != sizes.size()) {
    call.fail("one repeat per axis", std::to_string(repeats.size()));
  }
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    if (repeats[i] > 0 && sizes[i] > kMaxElements / repeats[i])
      sizes[i] = -1;
    else
      sizes[i] *= repeats[i];
  }
  call.check_size(sizes);
  return {x.repeat(repeats)};
}

/// Index of the source of each padded place along an axis; -1: the constant.
Sizes padded_indices(const NodeCall& call, const std::string& mode, std::int64_t n,
                     std::int64_t before, std::int64_t after) {
  Sizes picked;
  for (std::int64_t i = -before; i < n + after; ++i) {
    std::int64_t at = i;
    if (mode == "edge") {
      at = std::clamp<std::int64_t>(i, 0, n - 1);
    } else if (mode == "wrap") {
      at = ((i % n) + n) % n;
    } else if (n == 1) {
      at = 0;
    } else {
      const std::int64_t period = 2 * (n - 1), phase = ((i % period) + period) % period;
      at = phase < n ? phase : period - phase;
    }
    picked.push_back(at);
  }
  if (n == 0 && !picked.empty()) call.fail("something to pad with", "an empty axis");
  return picked;
}

Values pad(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::string mode = call.text_or("mode", "constant");
  if (mode != "constant" && mode != "reflect" && mode != "edge" && mode != "wrap") {
    call.fail("mode constant | reflect | edge | wrap", mode);
  }
  const Sizes given = call.has(1) ? call.integers(1) : call.integers_of("pads");
  Sizes axes;
  if (call.has(3)) {
    for (const std::int64_t a : call.integers(3)) axes.push_back(call.axis(a, x.dim()));
  } else {
    axes.resize(static_cast<std::size_t>(x.dim()));
    std::iota(axes.begin(), axes.end(), 0);
  }
  if (given.size() != 2 * axes.size()) {
    call.fail("two pads per axis", std::to_string(given.size()) + " numbers");
  }
  const auto rank = static_cast<std::size_t>(x.dim());
  Sizes pads(2 * rank, 0), sizes = sizes_of(x);
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const auto axis = static_cast<std::size_t>(axes[i]);
    for (const std::int64_t amount : {given[i], given[axes.size() + i]}) {
      if (amount < -kMaxElements || amount > kMaxElements) {
        call.fail("pads up to 2^30", std::to_string(amount));
      }
      sizes[axis] += amount;
    }
    pads[axis] = given[i];
    pads[rank + axis] = given[axes.size() + i];
  }
  call.check_size(sizes);
  if (mode == "constant") {
    const double value = call.has(2) ? call.real(2) : call.real_or("value", 0.0);
    return {at::constant_pad_nd(x, reversed_pads(pads), value)};
  }
  Tensor result = x;
  for (std::size_t i = 0; i < rank; ++i) {
    if (pads[i] == 0 && pads[rank + i] == 0) continue;
    const auto axis = static_cast<std::int64_t>(i);
    if (x.size(axis) == 0) call.fail("something to pad with", "an empty axis");
    result = at::index_select(
        result, axis,
        from_integers(padded_indices(call, mode, x.size(axis), pads[i], pads[rank + i])));
  }
  return {result};
}

Values constant(const NodeCall& call) {
  if (call.has_attribute("value")) {
    const Tensor& value = call.attribute("value").tensor;
    if (!value.defined()) call.fail("a tensor in 'value'", "another value");
    return {value};
  }
  if (call.has_attribute("value_int")) {
    return {at::scalar_tensor(call.attribute("value_int").integer, at::kLong)};
  }
  if (call.has_attribute("value_ints")) return {from_integers(call.integers_of("value_ints"))};
  if (call.has_attribute("value_float")) {
    return {at::scalar_tensor(call.attribute("value_float").real, at::kFloat)};
  }
  const std::vector<double>& reals = call.attribute("value_floats").reals;
  return {at::tensor(at::ArrayRef<double>(reals), at::kDouble).to(at::kFloat)};
}

Values constant_of_shape(const NodeCall& call) {
  const Sizes sizes = call.integers(0);
  call.check_size(sizes);
  if (!call.has_attribute("value")) return {at::zeros(sizes, at::kFloat)};
  const Tensor& value = call.attribute("value").tensor;
  if (!value.defined() || value.numel() != 1) call.fail("one number in 'value'", "others");
  return {value.reshape({}).expand(sizes).contiguous()};
}

Values range(const NodeCall& call) {
  const Tensor& start = call.input(0);
  const double delta = call.real(2);
  const double steps = std::ceil((call.real(1) - call.real(0)) / delta);
  if (delta == 0.0 || !(steps <= static_cast<double>(kMaxElements))) {
    call.fail("at most 2^30 steps", std::to_string(steps));
  }
  const auto count = static_cast<std::int64_t>(std::max(steps, 0.0));
  const Tensor ramp = at::arange(count, at::kLong).to(start.scalar_type());
  return {ramp * call.input(2).reshape({}) + start.reshape({})};
}

Values trilu(const NodeCall& call) {
  const std::int64_t k = call.has(1) ? call.integer(1) : 0;
  const Tensor& x = call.input(0);
  if (x.dim() < 2) call.fail("a matrix", shape_text(sizes_of(x)));
  // Beyond the matrix the diagonal makes no difference; the library may overflow on it.
  const std::int64_t reach = x.size(-1) + x.size(-2);
  const std::int64_t diagonal = std::clamp(k, -reach, reach);
  return {call.attribute_or("upper", 1) != 0 ? at::triu(x, diagonal) : at::tril(x, diagonal)};
}

Values eye_like(const NodeCall& call) {
  const Tensor& x = call.input(0);
  if (x.dim() != 2) call.fail("a matrix", shape_text(sizes_of(x)));
  const auto type = call.has_attribute("dtype")
                        ? type_of(call, call.attribute("dtype").integer)
                        : x.scalar_type();
  const Tensor row = at::arange(x.size(0), at::kLong).unsqueeze(1);
  const std::int64_t k =
      std::clamp<std::int64_t>(call.attribute_or("k", 0), -kMaxElements, kMaxElements);
  return {(at::arange(x.size(1), at::kLong) - row).eq(k).to(type)};
}

/// [b, c, h, w] -> blocks of channels become places, and back.
Values depth_to_space(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::int64_t b = call.attribute("blocksize").integer;
  if (x.dim() != 4 || b < 1 || b > kMaxElements || x.size(1) % (b * b) != 0) {
    call.fail("[b, c, h, w] with channels for blocks of " + std::to_string(b),
              shape_text(sizes_of(x)));
  }
  const std::int64_t n = x.size(0), c = x.size(1) / (b * b), h = x.size(2), w = x.size(3);
  const bool columns_first = call.text_or("mode", "DCR") == "CRD";
  const Tensor blocks = columns_first
                            ? x.reshape({n, c, b, b, h, w}).permute({0, 1, 4, 2, 5, 3})
                            : x.reshape({n, b, b, c, h, w}).permute({0, 3, 4, 1, 5, 2});
  return {blocks.reshape({n, c, h * b, w * b})};
}

Values space_to_depth(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::int64_t b = call.attribute("blocksize").integer;
  if (x.dim() != 4 || b < 1 || x.size(2) % b != 0 || x.size(3) % b != 0) {
    call.fail("[b, c, h, w] with sides for blocks of " + std::to_string(b),
              shape_text(sizes_of(x)));
  }
  const std::int64_t n = x.size(0), c = x.size(1), h = x.size(2) / b, w = x.size(3) / b;
  return {
      x.reshape({n, c, h, b, w, b}).permute({0, 3, 5, 1, 2, 4}).reshape({n, c * b * b, h, w})};
}

constexpr Operator kOperators[] = {
    {"Concat", 4, kLastOpset, 1, -1, "axis", concat},
    {"Constant", 1, kLastOpset, 0, 0, "value value_int value_ints value_float value_floats",
     constant},
    {"ConstantOfShape", 9, kLastOpset, 1, 1, "value", constant_of_shape},
    {"DepthToSpace", 1, kLastOpset, 1, 1, "blocksize mode", depth_to_space},
    {"Expand", 8, kLastOpset, 2, 2, "", expand},
    {"EyeLike", 9, kLastOpset, 1, 1, "dtype k", eye_like},
    {"Flatten", 1, kLastOpset, 1, 1, "axis", flatten},
    {"Pad", 2, kLastOpset, 1, 4, "mode pads value", pad},
    {"Range", 11, kLastOpset, 3, 3, "", range},
    {"Reshape", 5, kLastOpset, 2, 2, "allowzero", reshape},
    {"Shape", 1, kLastOpset, 1, 1, "start end", shape},
    {"Size", 1, kLastOpset, 1, 1, "", size},
    {"Slice", 1, kLastOpset, 1, 5, "starts ends axes", slice},
    {"SpaceToDepth", 1, kLastOpset, 1, 1, "blocksize", space_to_depth},
    {"Split", 2, kLastOpset, 1, 2, "axis split num_outputs", split},
    {"Squeeze", 1, kLastOpset, 1, 2, "axes", squeeze},
    {"Tile", 6, kLastOpset, 2, 2, "", tile},
    {"Transpose", 1, kLastOpset, 1, 1, "perm", transpose},
    {"Trilu", 14, kLastOpset, 1, 2, "upper", trilu},
    {"Unsqueeze", 1, kLastOpset, 1, 2, "axes", unsqueeze},
};

}  // namespace

std::span<const Operator> shape_operators() { return kOperators; }

}  // namespace segsim::perception::graph
