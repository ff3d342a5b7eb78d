#pragma once

/// @file
/// An ONNX graph as the executor wants it: names resolved to numbered slots, each operator
/// resolved to a function, constants computed. The file format itself (protobuf) stays in
/// onnx_reader.cpp and onnx_tensor.cpp.
///
///     file --parse--> Graph --fold--> Graph without constant nodes --execute--> tensors
///
/// Types: float16 and bfloat16 are computed as float (libtorch on the CPU lacks most of them),
/// uint16 as int32, uint32 and uint64 as int64. Strings, complex numbers and sparse tensors
/// are refused.

#include <ATen/ATen.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "perception/models/model_session.h"

namespace segsim::perception::graph {

/// Place of a value while a graph runs.
using Slot = std::uint32_t;
inline constexpr Slot kNoSlot = 0xFFFFFFFF;  ///< An input or output that is left out.

/// No tensor of a model may have more elements: a damaged size is an error, not an attempt.
inline constexpr std::int64_t kMaxElements = std::int64_t{1} << 30U;

/// A tensor, a list of tensors, or nothing.
struct Value {
  at::Tensor tensor;
  std::shared_ptr<const std::vector<at::Tensor>> list;

  Value() = default;
  Value(at::Tensor t) : tensor(std::move(t)) {}  // NOLINT: results are lists of tensors.
  explicit Value(std::vector<at::Tensor> items)
      : list(std::make_shared<const std::vector<at::Tensor>>(std::move(items))) {}
  [[nodiscard]] bool defined() const { return tensor.defined() || list != nullptr; }
};
using Values = std::vector<Value>;

struct Graph;
class NodeCall;
using OperatorFunction = Values (*)(const NodeCall& call);

/// The meanings of operators that are known.
inline constexpr int kFirstOpset = 7, kLastOpset = 22;

/// One line of the table of operators.
struct Operator {
  const char* name;
  int first_opset, last_opset;  ///< Meanings that the function knows.
  int min_inputs, max_inputs;   ///< max < 0: any number.
  const char* attributes;       ///< Those that the function reads, separated by spaces.
  OperatorFunction function;
};

struct Attribute {
  std::int64_t integer = 0;
  double real = 0.0;
  std::string text;
  std::vector<std::int64_t> integers;
  std::vector<double> reals;
  at::Tensor tensor;
  std::shared_ptr<const Graph> graph;
};

struct Node {
  std::string name, op_type;
  int opset = 0;
  const Operator* op = nullptr;
  std::map<std::string, Attribute> attributes;
  std::vector<Slot> inputs, outputs;  ///< kNoSlot where left out.
  std::vector<Slot> released;         ///< Not needed after this node.

  /// "node 'head/conv' (Conv, opset 17)"
  [[nodiscard]] std::string describe() const;
};

struct Graph {
  std::vector<std::string> slot_names;  ///< Per slot.
  std::vector<Slot> inputs, outputs;
  std::vector<Node> nodes;  ///< Each after those it needs.
  std::vector<std::pair<Slot, at::Tensor>> constants;
  /// Values of the graph around it: slot there, slot here.
  std::vector<std::pair<Slot, Slot>> captures;
};

struct Model {
  std::string place;  ///< The file, for messages.
  Graph graph;
  std::vector<TensorInfo> inputs, outputs;  ///< Inputs without a default, in order.
  std::vector<at::ScalarType> input_types;
  std::map<std::string, std::string> metadata;
};

/// Reads and checks a file, and computes what does not depend on inputs.
/// @throws core::InputError as open_model() says.
[[nodiscard]] std::shared_ptr<const Model> read_model(const std::filesystem::path& file);

/// Runs a graph. @param inputs  One per graph.inputs. @param around  Values of the graph
/// around it; empty for the main graph.
[[nodiscard]] Values execute(const Graph& graph, const std::string& place, Values inputs,
                             const Values& around);

/// Runs one node. @param slots  Of its graph.
[[nodiscard]] Values execute_node(const Node& node, const std::string& place,
                                  const Values& slots);

/// Computes nodes whose inputs are constants, drops constants that nobody needs any more, and
/// fills Node::released. For the main graph and the graphs inside it.
void fold_constants(Graph& graph, const std::string& place);

/// nullptr if there is none of that name.
[[nodiscard]] const Operator* find_operator(std::string_view name);
/// Names of all operators, ascending.
[[nodiscard]] std::vector<std::string> operator_names();

}  // namespace segsim::perception::graph
