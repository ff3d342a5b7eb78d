#include "perception/models/internal/onnx/onnx_node_call.h"

#include <algorithm>

#include "core/check.h"
#include "core/error.h"
#include "perception/models/internal/onnx/onnx_tensor.h"

namespace segsim::perception::graph {

const Value& NodeCall::slot(std::size_t i) const {
  static const Value kNothing;
  if (i >= node_.inputs.size() || node_.inputs[i] == kNoSlot) return kNothing;
  return slots_[node_.inputs[i]];
}

bool NodeCall::has(std::size_t i) const { return slot(i).defined(); }

const at::Tensor& NodeCall::input(std::size_t i) const {
  const Value& value = slot(i);
  if (!value.tensor.defined()) {
    fail("a tensor as input " + std::to_string(i), value.defined() ? "a list" : "nothing");
  }
  return value.tensor;
}

at::Tensor NodeCall::optional_input(std::size_t i) const {
  return has(i) ? input(i) : at::Tensor();
}

const std::vector<at::Tensor>& NodeCall::list_input(std::size_t i) const {
  const Value& value = slot(i);
  if (value.list == nullptr) fail("a list as input " + std::to_string(i), "a tensor");
  return *value.list;
}

std::vector<at::Tensor> NodeCall::tensors() const {
  std::vector<at::Tensor> all;
  for (std::size_t i = 0; i < input_count(); ++i) all.push_back(input(i));
  return all;
}

std::vector<std::int64_t> NodeCall::integers(std::size_t i) const {
  const at::Tensor flat = input(i).to(at::kLong).contiguous().reshape({-1});
  const auto* data = flat.data_ptr<std::int64_t>();
  return {data, data + flat.numel()};
}

std::int64_t NodeCall::integer(std::size_t i) const {
  if (input(i).numel() != 1) {
    fail("one number as input " + std::to_string(i), shape_text(input(i).sizes().vec()));
  }
  return input(i).to(at::kLong).item<std::int64_t>();
}

double NodeCall::real(std::size_t i) const {
  if (input(i).numel() != 1) {
    fail("one number as input " + std::to_string(i), shape_text(input(i).sizes().vec()));
  }
  return input(i).to(at::kDouble).item<double>();
}

const Attribute& NodeCall::attribute(const char* name) const {
  const auto found = node_.attributes.find(name);
  if (found == node_.attributes.end()) fail(std::string("attribute '") + name + "'", "none");
  return found->second;
}

std::int64_t NodeCall::attribute_or(const char* name, std::int64_t fallback) const {
  const auto found = node_.attributes.find(name);
  return found == node_.attributes.end() ? fallback : found->second.integer;
}

double NodeCall::real_or(const char* name, double fallback) const {
  const auto found = node_.attributes.find(name);
  return found == node_.attributes.end() ? fallback : found->second.real;
}

std::string NodeCall::text_or(const char* name, const char* fallback) const {
  const auto found = node_.attributes.find(name);
  return found == node_.attributes.end() ? fallback : found->second.text;
}

std::vector<std::int64_t> NodeCall::integers_of(const char* name) const {
  const auto found = node_.attributes.find(name);
  return found == node_.attributes.end() ? std::vector<std::int64_t>{}
                                         : found->second.integers;
}

Values NodeCall::run_graph(const char* name, Values inputs) const {
  const Attribute& found = attribute(name);
  if (found.graph == nullptr) fail(std::string("a graph in '") + name + "'", "another value");
  return execute(*found.graph, place_, std::move(inputs), slots_);
}

void NodeCall::fail(const std::string& expected, const std::string& found) const {
  throw core::InputError::expected(place_ + ": " + node_.describe(), expected, found);
}

std::int64_t NodeCall::axis(std::int64_t axis, std::int64_t rank) const {
  if (axis < -rank || axis >= rank) {
    fail("an axis in [" + std::to_string(-rank) + ", " + std::to_string(rank) + ")",
         std::to_string(axis));
  }
  return axis < 0 ? axis + rank : axis;
}

std::vector<std::int64_t> NodeCall::axes(std::vector<std::int64_t> axes,
                                         std::int64_t rank) const {
  for (std::int64_t& a : axes) a = axis(a, rank);
  std::sort(axes.begin(), axes.end());
  if (std::adjacent_find(axes.begin(), axes.end()) != axes.end()) {
    fail("distinct axes", shape_text(axes));
  }
  return axes;
}

void NodeCall::check_size(std::span<const std::int64_t> shape) const {
  std::int64_t count = 1;
  for (const std::int64_t side : shape) {
    if (side < 0 || (side > 0 && count > kMaxElements / side)) {
      fail("a shape of at most 2^30 elements", shape_text({shape.begin(), shape.end()}));
    }
    count *= side;
  }
}

at::Tensor NodeCall::indices(const at::Tensor& raw, std::int64_t count) const {
  if (at::isFloatingType(raw.scalar_type())) fail("integers as indices", "floating numbers");
  at::Tensor wrapped = raw.to(at::kLong);
  wrapped = at::where(wrapped.lt(0), wrapped + count, wrapped);
  if (wrapped.numel() == 0) return wrapped;
  const auto low = wrapped.min().item<std::int64_t>();
  const auto high = wrapped.max().item<std::int64_t>();
  if (low < 0 || high >= count) {
    fail("indices in [-" + std::to_string(count) + ", " + std::to_string(count) + ")",
         std::to_string(low < 0 ? low - count : high));
  }
  return wrapped;
}

std::vector<std::int64_t> per_axis(const NodeCall& call, const char* attribute,
                                   std::size_t count, std::int64_t fallback,
                                   std::int64_t low) {
  std::vector<std::int64_t> values = call.integers_of(attribute);
  if (values.empty()) values.assign(count, fallback);
  const bool fits = values.size() == count &&
                    std::all_of(values.begin(), values.end(), [&](std::int64_t value) {
                      return value >= low && value <= kMaxElements;
                    });
  if (!fits) {
    call.fail(std::to_string(count) + " numbers from " + std::to_string(low) + " in '" +
                  attribute + "'",
              shape_text(values));
  }
  return values;
}

std::vector<std::int64_t> window_pads(const NodeCall& call,
                                      std::span<const std::int64_t> spatial,
                                      std::span<const std::int64_t> kernel,
                                      std::span<const std::int64_t> strides,
                                      std::span<const std::int64_t> dilations) {
  const std::size_t n = spatial.size();
  const std::string automatic = call.text_or("auto_pad", "NOTSET");
  if (automatic == "NOTSET" || automatic.empty()) {
    return per_axis(call, "pads", 2 * n, 0, 0);
  }
  std::vector<std::int64_t> pads(2 * n, 0);
  if (automatic == "VALID") return pads;
  if (automatic != "SAME_UPPER" && automatic != "SAME_LOWER") {
    call.fail("auto_pad NOTSET | VALID | SAME_UPPER | SAME_LOWER", automatic);
  }
  for (std::size_t i = 0; i < n; ++i) {
    const std::int64_t out = (spatial[i] + strides[i] - 1) / strides[i];
    const std::int64_t reach =
        (out - 1) * strides[i] + (kernel[i] - 1) * dilations[i] + 1 - spatial[i];
    const std::int64_t total = std::max<std::int64_t>(0, reach);
    pads[i] = automatic == "SAME_UPPER" ? total / 2 : total - total / 2;
    pads[n + i] = total - pads[i];
  }
  return pads;
}

std::vector<std::int64_t> reversed_pads(std::span<const std::int64_t> pads) {
  const std::size_t n = pads.size() / 2;
  std::vector<std::int64_t> reversed;
  for (std::size_t i = n; i-- > 0;) {
    reversed.push_back(pads[i]);
    reversed.push_back(pads[n + i]);
  }
  return reversed;
}

at::ScalarType type_of(const NodeCall& call, std::int64_t onnx_type) {
  try {
    return scalar_type(static_cast<int>(onnx_type), "");
  } catch (const core::InputError&) {
    call.fail("a floating, integer or bool type",
              type_name(static_cast<int>(onnx_type)) + ", which is not supported");
  }
}

}  // namespace segsim::perception::graph
