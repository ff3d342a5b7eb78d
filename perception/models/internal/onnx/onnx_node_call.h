#pragma once

/// @file
/// What an operator sees of its node: inputs, attributes, and a way to complain.

#include <ATen/ATen.h>

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "perception/models/internal/onnx/onnx_model.h"

namespace segsim::perception::graph {

class NodeCall {
 public:
  NodeCall(const Node& node, const std::string& place, const Values& slots)
      : node_(node), place_(place), slots_(slots) {}

  [[nodiscard]] int opset() const { return node_.opset; }
  [[nodiscard]] std::size_t input_count() const { return node_.inputs.size(); }
  /// Whether output i is wanted.
  [[nodiscard]] bool wants(std::size_t i) const {
    return i < node_.outputs.size() && node_.outputs[i] != kNoSlot;
  }
  [[nodiscard]] std::size_t output_count() const { return node_.outputs.size(); }

  [[nodiscard]] bool has(std::size_t i) const;
  [[nodiscard]] const Value& value(std::size_t i) const { return slot(i); }
  /// A tensor that must be there.
  [[nodiscard]] const at::Tensor& input(std::size_t i) const;
  /// An undefined tensor if it is left out.
  [[nodiscard]] at::Tensor optional_input(std::size_t i) const;
  [[nodiscard]] const std::vector<at::Tensor>& list_input(std::size_t i) const;
  [[nodiscard]] std::vector<at::Tensor> tensors() const;  ///< All inputs.
  /// An integer tensor as numbers.
  [[nodiscard]] std::vector<std::int64_t> integers(std::size_t i) const;
  [[nodiscard]] std::int64_t integer(std::size_t i) const;
  [[nodiscard]] double real(std::size_t i) const;

  [[nodiscard]] bool has_attribute(const char* name) const {
    return node_.attributes.contains(name);
  }
  [[nodiscard]] const Attribute& attribute(const char* name) const;
  [[nodiscard]] std::int64_t attribute_or(const char* name, std::int64_t fallback) const;
  [[nodiscard]] double real_or(const char* name, double fallback) const;
  [[nodiscard]] std::string text_or(const char* name, const char* fallback) const;
  /// Empty if there is none.
  [[nodiscard]] std::vector<std::int64_t> integers_of(const char* name) const;

  /// Runs the graph of an attribute.
  [[nodiscard]] Values run_graph(const char* attribute, Values inputs) const;

  /// @throws core::InputError: "<file>: node ...: expected ..., found ..."
  [[noreturn]] void fail(const std::string& expected, const std::string& found) const;
  /// An axis of a tensor of that rank, negative ones counted from the end.
  [[nodiscard]] std::int64_t axis(std::int64_t axis, std::int64_t rank) const;
  /// Distinct axes, ascending.
  [[nodiscard]] std::vector<std::int64_t> axes(std::vector<std::int64_t> axes,
                                               std::int64_t rank) const;
  /// Refuses shapes with negative sides or more than kMaxElements elements.
  void check_size(std::span<const std::int64_t> shape) const;
  /// int64 indices in [0, count); negative ones are counted from the end.
  [[nodiscard]] at::Tensor indices(const at::Tensor& raw, std::int64_t count) const;

 private:
  [[nodiscard]] const Value& slot(std::size_t i) const;

  const Node& node_;
  const std::string& place_;
  const Values& slots_;
};

/// Left, top, ..., right, bottom, ...: of windows that move over `spatial` sides, from the
/// attributes auto_pad and pads.
[[nodiscard]] std::vector<std::int64_t> window_pads(const NodeCall& call,
                                                    std::span<const std::int64_t> spatial,
                                                    std::span<const std::int64_t> kernel,
                                                    std::span<const std::int64_t> strides,
                                                    std::span<const std::int64_t> dilations);
/// `pads` as at::constant_pad_nd() wants them.
[[nodiscard]] std::vector<std::int64_t> reversed_pads(std::span<const std::int64_t> pads);
/// A list attribute with one number per spatial axis, each at least `low`.
[[nodiscard]] std::vector<std::int64_t> per_axis(const NodeCall& call, const char* attribute,
                                                 std::size_t count, std::int64_t fallback,
                                                 std::int64_t low);
/// Type of an ONNX type number in an attribute. @throws core::InputError naming the node.
[[nodiscard]] at::ScalarType type_of(const NodeCall& call, std::int64_t onnx_type);

/// Tables, one per file of operators.
[[nodiscard]] std::span<const Operator> elementwise_operators();
[[nodiscard]] std::span<const Operator> shape_operators();
[[nodiscard]] std::span<const Operator> index_operators();
[[nodiscard]] std::span<const Operator> window_operators();
[[nodiscard]] std::span<const Operator> norm_operators();
[[nodiscard]] std::span<const Operator> reduce_operators();
[[nodiscard]] std::span<const Operator> matrix_operators();
[[nodiscard]] std::span<const Operator> resample_operators();
[[nodiscard]] std::span<const Operator> region_operators();
[[nodiscard]] std::span<const Operator> flow_operators();

}  // namespace segsim::perception::graph
