// Operators that pick and place numbers by index.
#include <algorithm>
#include <numeric>

#include <ATen/NumericUtils.h>

#include "perception/models/internal/onnx/onnx_node_call.h"

namespace segsim::perception::graph {
namespace {

using at::Tensor;
using Sizes = std::vector<std::int64_t>;

std::int64_t product(at::IntArrayRef sizes) {
  return std::accumulate(sizes.begin(), sizes.end(), std::int64_t{1}, std::multiplies<>());
}

Sizes joined(at::IntArrayRef a, at::IntArrayRef b, at::IntArrayRef c = {}) {
  Sizes all = a.vec();
  all.insert(all.end(), b.begin(), b.end());
  all.insert(all.end(), c.begin(), c.end());
  return all;
}

Values gather(const NodeCall& call) {
  const Tensor& data = call.input(0);
  const std::int64_t axis = call.axis(call.attribute_or("axis", 0), data.dim());
  const Tensor index = call.indices(call.input(1), data.size(axis));
  const at::IntArrayRef sizes = data.sizes();
  const auto at = static_cast<std::size_t>(axis);
  return {at::index_select(data, axis, index.reshape({-1}))
              .reshape(joined(sizes.slice(0, at), index.sizes(), sizes.slice(at + 1)))};
}

Values gather_elements(const NodeCall& call) {
  const Tensor& data = call.input(0);
  const std::int64_t axis = call.axis(call.attribute_or("axis", 0), data.dim());
  return {at::gather(data, axis, call.indices(call.input(1), data.size(axis)))};
}

/// Tuples of indices [..., k] into the first k of `sizes`, as row numbers.
Tensor row_numbers(const NodeCall& call, const Tensor& tuples, at::IntArrayRef sizes) {
  const std::int64_t k = tuples.size(-1);
  if (k > static_cast<std::int64_t>(sizes.size())) {
    call.fail("tuples of at most " + std::to_string(sizes.size()) + " indices",
              std::to_string(k));
  }
  Tensor rows = at::zeros(tuples.sizes().slice(0, static_cast<std::size_t>(tuples.dim() - 1)),
                          at::kLong);
  for (std::int64_t j = 0; j < k; ++j) {
    const std::int64_t side = sizes[static_cast<std::size_t>(j)];
    rows = rows * side + call.indices(tuples.select(-1, j), side);
  }
  return rows;
}

Values gather_nd(const NodeCall& call) {
  const Tensor &data = call.input(0), &tuples = call.input(1);
  const std::int64_t raw = call.attribute_or("batch_dims", 0);
  if (tuples.dim() < 1 || raw < 0 || raw >= tuples.dim() || raw >= data.dim()) {
    call.fail("fewer batch_dims than axes", std::to_string(raw));
  }
  const auto batch_axes = static_cast<std::size_t>(raw);
  const at::IntArrayRef sizes = data.sizes();
  const at::IntArrayRef batch = sizes.slice(0, batch_axes);
  if (tuples.sizes().slice(0, batch_axes) != batch) {
    call.fail("equal batch axes", shape_text(tuples.sizes().vec()));
  }
  const auto k = static_cast<std::size_t>(tuples.size(-1));
  if (batch_axes + k > sizes.size()) {
    call.fail("tuples of at most " + std::to_string(sizes.size() - batch_axes) + " indices",
              std::to_string(k));
  }
  const at::IntArrayRef picked = sizes.slice(batch_axes, k),
                        rest = sizes.slice(batch_axes + k);
  Tensor rows = row_numbers(call, tuples, picked);
  const at::IntArrayRef places = rows.sizes();
  const Tensor image = at::arange(product(batch), at::kLong).unsqueeze(1) * product(picked);
  const Tensor flat =
      (rows.reshape({product(batch), product(places.slice(batch_axes))}) + image)
          .reshape({-1});
  const Tensor table = data.reshape({product(batch) * product(picked), product(rest)});
  return {at::index_select(table, 0, flat).reshape(joined(places, rest))};
}

/// Writes or combines `updates` along `axis`.
Tensor scatter(const NodeCall& call, const Tensor& data, std::int64_t axis,
               const Tensor& index, const Tensor& updates) {
  const std::string how = call.text_or("reduction", "none");
  if (how == "none") return at::scatter(data, axis, index, updates);
  if (how == "add") return at::scatter_add(data, axis, index, updates);
  for (const auto& [onnx, aten] :
       {std::pair{"mul", "prod"}, {"max", "amax"}, {"min", "amin"}}) {
    if (how == onnx) return at::scatter_reduce(data, axis, index, updates, aten);
  }
  call.fail("reduction none | add | mul | max | min", how);
}

Values scatter_elements(const NodeCall& call) {
  const Tensor& data = call.input(0);
  const std::int64_t axis = call.axis(call.attribute_or("axis", 0), data.dim());
  const Tensor index = call.indices(call.input(1), data.size(axis));
  if (index.sizes() != call.input(2).sizes()) {
    call.fail("as many updates as indices", shape_text(call.input(2).sizes().vec()));
  }
  return {scatter(call, data, axis, index, call.input(2))};
}

Values scatter_nd(const NodeCall& call) {
  const Tensor &data = call.input(0), &tuples = call.input(1), &updates = call.input(2);
  if (tuples.dim() < 1) call.fail("tuples of indices", "a number");
  const at::IntArrayRef sizes = data.sizes();
  const Tensor rows = row_numbers(call, tuples, sizes);
  const auto k = static_cast<std::size_t>(tuples.size(-1));
  const std::int64_t width = product(sizes.slice(k));
  const Sizes wanted = joined(rows.sizes(), sizes.slice(k));
  if (updates.sizes() != at::IntArrayRef(wanted)) {
    call.fail("updates of shape " + shape_text(wanted), shape_text(updates.sizes().vec()));
  }
  const Tensor index = rows.reshape({-1, 1}).expand({rows.numel(), width});
  const Tensor table = data.reshape({product(sizes.slice(0, k)), width});
  return {
      scatter(call, table, 0, index, updates.reshape({rows.numel(), width})).reshape(sizes)};
}

Values one_hot(const NodeCall& call) {
  const Tensor raw = call.input(0).to(at::kLong);
  const std::int64_t depth = call.integer(1);
  if (depth < 1 || depth > kMaxElements || call.input(2).numel() != 2) {
    call.fail("a depth from 1 and two values", std::to_string(depth));
  }
  const std::int64_t axis = call.axis(call.attribute_or("axis", -1), raw.dim() + 1);
  const Tensor index = at::where(raw.lt(0), raw + depth, raw).unsqueeze(axis);
  Sizes line(static_cast<std::size_t>(raw.dim() + 1), 1), full = index.sizes().vec();
  line[static_cast<std::size_t>(axis)] = full[static_cast<std::size_t>(axis)] = depth;
  call.check_size(full);
  const Tensor hot = index.eq(at::arange(depth, at::kLong).reshape(line));
  const Tensor values = call.input(2).reshape({-1});
  return {at::where(hot, values.select(0, 1), values.select(0, 0))};
}

Values non_zero(const NodeCall& call) {
  return {at::nonzero(call.input(0)).transpose(0, 1).contiguous()};
}

Values compress(const NodeCall& call) {
  const bool flat = !call.has_attribute("axis");
  const Tensor data = flat ? call.input(0).reshape({-1}) : call.input(0);
  const std::int64_t axis = flat ? 0 : call.axis(call.attribute("axis").integer, data.dim());
  const Tensor picked = at::nonzero(call.input(1).reshape({-1})).reshape({-1});
  return {at::index_select(data, axis, call.indices(picked, data.size(axis)))};
}

/// The k best of one row; equal ones by ascending index. NaN is the largest.
template <class Number>
void pick_best(const Number* row, std::int64_t stride, std::int64_t n, std::int64_t k,
               bool largest, std::vector<std::int64_t>& order) {
  order.resize(static_cast<std::size_t>(n));
  std::iota(order.begin(), order.end(), 0);
  const auto above = [&](std::int64_t a, std::int64_t b) {
    const Number x = row[a * stride], y = row[b * stride];
    const bool x_nan = at::_isnan(x), y_nan = at::_isnan(y);
    if (x_nan != y_nan) return x_nan == largest;
    if (!x_nan && x != y) return largest ? x > y : x < y;
    return a < b;
  };
  const auto middle = order.begin() + k;
  if (middle != order.end()) std::nth_element(order.begin(), middle, order.end(), above);
  std::sort(order.begin(), middle, above);
  order.resize(static_cast<std::size_t>(k));
}

Values top_k(const NodeCall& call) {
  const Tensor& raw = call.input(0);
  const std::int64_t axis = call.axis(call.attribute_or("axis", -1), raw.dim());
  const std::int64_t k = call.has(1) ? call.integer(1) : call.attribute("k").integer;
  const Tensor x = raw.transpose(axis, -1).contiguous();
  const std::int64_t n = x.size(-1);
  if (k < 0 || k > n) call.fail("k from 0 to " + std::to_string(n), std::to_string(k));
  const bool largest = call.attribute_or("largest", 1) != 0;
  Sizes sizes = x.sizes().vec();
  sizes.back() = k;
  Tensor index = at::empty(sizes, at::kLong);
  auto* out = index.data_ptr<std::int64_t>();
  std::vector<std::int64_t> order;
  const std::int64_t rows = n == 0 ? 0 : x.numel() / n;
  AT_DISPATCH_ALL_TYPES(x.scalar_type(), "TopK", [&] {
    const auto* data = x.data_ptr<scalar_t>();
    for (std::int64_t r = 0; r < rows; ++r) {
      pick_best(data + r * n, 1, n, k, largest, order);
      out = std::copy(order.begin(), order.end(), out);
    }
  });
  return {at::gather(x, -1, index).transpose(axis, -1), index.transpose(axis, -1)};
}

constexpr Operator kOperators[] = {
    {"Compress", 9, kLastOpset, 2, 2, "axis", compress},
    {"Gather", 1, kLastOpset, 2, 2, "axis", gather},
    {"GatherElements", 11, kLastOpset, 2, 2, "axis", gather_elements},
    {"GatherND", 11, kLastOpset, 2, 2, "batch_dims", gather_nd},
    {"NonZero", 9, kLastOpset, 1, 1, "", non_zero},
    {"OneHot", 9, kLastOpset, 3, 3, "axis", one_hot},
    {"Scatter", 9, kLastOpset, 3, 3, "axis", scatter_elements},
    {"ScatterElements", 11, kLastOpset, 3, 3, "axis reduction", scatter_elements},
    {"ScatterND", 11, kLastOpset, 3, 3, "reduction", scatter_nd},
    {"TopK", 1, kLastOpset, 1, 2, "axis k largest sorted", top_k},
};

}  // namespace

std::span<const Operator> index_operators() { return kOperators; }

}  // namespace segsim::perception::graph
