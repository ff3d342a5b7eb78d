// An ONNX file -> Graph: names become slots, operators and attributes are checked.
#include <onnx/onnx_pb.h>

#include <fstream>
#include <optional>
#include <set>

#include "core/error.h"
#include "perception/models/internal/onnx/onnx_model.h"
#include "perception/models/internal/onnx/onnx_tensor.h"

namespace segsim::perception::graph {
namespace {

namespace fs = std::filesystem;
using core::InputError;

constexpr int kMaxDepth = 16;  ///< Of graphs inside graphs.

struct Source {
  std::string place;
  fs::path folder;
  int opset = 0;
};

TensorInfo info_of(const ::onnx::ValueInfoProto& proto) {
  TensorInfo info;
  info.name = proto.name();
  if (!proto.type().has_tensor_type()) return info;
  const auto& type = proto.type().tensor_type();
  info.type = type_name(type.elem_type());
  info.shape_known = type.has_shape();
  for (const auto& side : type.shape().dim()) {
    info.shape.push_back(side.has_dim_value() && side.dim_value() >= 0 ? side.dim_value()
                                                                       : -1);
  }
  return info;
}

/// Builds one graph; graphs inside it are built by builders that know this one.
class Builder {
 public:
  Builder(const Source& source, Builder* around, int depth)
      : source_(source), around_(around), depth_(depth) {
    if (depth > kMaxDepth) {
      throw InputError::expected(
          source.place, "at most " + std::to_string(kMaxDepth) + " nested graphs", "more");
    }
  }

  Graph build(const ::onnx::GraphProto& proto) {
    if (proto.sparse_initializer_size() > 0) {
      throw InputError::expected(source_.place, "dense initializers", "sparse ones");
    }
    std::set<std::string> constants;
    for (const auto& tensor : proto.initializer()) {
      const std::string place = source_.place + ": initializer '" + tensor.name() + "'";
      graph_.constants.emplace_back(define(tensor.name()),
                                    read_tensor(tensor, source_.folder, place));
      constants.insert(tensor.name());
    }
    for (const auto& input : proto.input()) {  // Before IR 4 initializers are inputs as well.
      if (!constants.contains(input.name())) graph_.inputs.push_back(define(input.name()));
    }
    for (const auto& node : proto.node()) add_node(node);
    for (const auto& output : proto.output()) {
      graph_.outputs.push_back(require(output.name(), "output of the graph"));
    }
    return std::move(graph_);
  }

 private:
  Slot new_slot(const std::string& name) {
    graph_.slot_names.push_back(name);
    const auto slot = static_cast<Slot>(graph_.slot_names.size() - 1);
    slots_[name] = slot;
    return slot;
  }

  Slot define(const std::string& name) {
    if (name.empty() || slots_.contains(name)) {
      throw InputError::expected(source_.place, "each value made once and named",
                                 "'" + name + "' again");
    }
    return new_slot(name);
  }

  /// A slot of this graph with the value of that name, captured from around if need be.
  std::optional<Slot> find(const std::string& name) {
    const auto found = slots_.find(name);
    if (found != slots_.end()) return found->second;
    if (around_ == nullptr) return std::nullopt;
    const std::optional<Slot> outside = around_->find(name);
    if (!outside) return std::nullopt;
    const Slot inside = new_slot(name);
    graph_.captures.emplace_back(*outside, inside);
    return inside;
  }

  Slot require(const std::string& name, const std::string& who) {
    const std::optional<Slot> slot = find(name);
    if (!slot) {
      throw InputError::expected(source_.place + ": " + who,
                                 "'" + name + "' to be made by a node before it", "none");
    }
    return *slot;
  }

  void add_node(const ::onnx::NodeProto& proto) {
    Node node;
    node.op_type = proto.op_type();
    node.opset = source_.opset;
    node.name = !proto.name().empty()     ? proto.name()
                : proto.output_size() > 0 ? "making " + proto.output(0)
                                          : "";
    check_operator(proto, node);
    for (const auto& name : proto.input()) {
      node.inputs.push_back(name.empty() ? kNoSlot : require(name, node.describe()));
    }
    const auto inputs = static_cast<int>(node.inputs.size());
    if (inputs < node.op->min_inputs ||
        (node.op->max_inputs >= 0 && inputs > node.op->max_inputs)) {
      throw InputError::expected(
          source_.place + ": " + node.describe(),
          "from " + std::to_string(node.op->min_inputs) + " to " +
              (node.op->max_inputs < 0 ? "any" : std::to_string(node.op->max_inputs)) +
              " inputs",
          std::to_string(inputs));
    }
    for (const auto& attribute : proto.attribute()) add_attribute(attribute, node);
    for (const auto& name : proto.output()) {
      node.outputs.push_back(name.empty() ? kNoSlot : define(name));
    }
    graph_.nodes.push_back(std::move(node));
  }

  void check_operator(const ::onnx::NodeProto& proto, Node& node) const {
    const bool standard = proto.domain().empty() || proto.domain() == "ai.onnx";
    node.op = standard ? find_operator(proto.op_type()) : nullptr;
    if (node.op == nullptr) {
      throw InputError::expected(
          source_.place + ": " + node.describe(), "an operator that is supported",
          standard ? node.op_type : node.op_type + " of domain " + proto.domain());
    }
    if (node.opset < node.op->first_opset || node.opset > node.op->last_opset) {
      throw InputError::expected(source_.place + ": " + node.describe(),
                                 node.op_type + " of opset " +
                                     std::to_string(node.op->first_opset) + " to " +
                                     std::to_string(node.op->last_opset),
                                 std::to_string(node.opset));
    }
  }

  void add_attribute(const ::onnx::AttributeProto& proto, Node& node) {
    const std::string known = " " + std::string(node.op->attributes) + " ";
    const std::string place =
        source_.place + ": " + node.describe() + ": attribute '" + proto.name() + "'";
    if (proto.name().empty() || known.find(" " + proto.name() + " ") == std::string::npos) {
      throw InputError::expected(place, "one of:" + known.substr(0, known.size() - 1),
                                 "another, which is not supported");
    }
    if (!proto.ref_attr_name().empty()) {
      throw InputError::expected(place, "a value", "a reference to a function's attribute");
    }
    Attribute attribute;
    attribute.integer = proto.i();
    attribute.real = static_cast<double>(proto.f());
    attribute.text = proto.s();
    attribute.integers.assign(proto.ints().begin(), proto.ints().end());
    attribute.reals.assign(proto.floats().begin(), proto.floats().end());
    if (proto.has_t()) attribute.tensor = read_tensor(proto.t(), source_.folder, place);
    if (proto.has_g()) {
      Builder inner(source_, this, depth_ + 1);
      attribute.graph = std::make_shared<const Graph>(inner.build(proto.g()));
      for (const auto& [outside, inside] : attribute.graph->captures) {
        node.inputs.push_back(outside);  // Behind its own: they live as long as the node.
      }
    }
    node.attributes[proto.name()] = std::move(attribute);
  }

  const Source& source_;
  Builder* around_;
  int depth_;
  Graph graph_;
  std::map<std::string, Slot> slots_;
};

int opset_of(const ::onnx::ModelProto& proto, const std::string& place) {
  for (const auto& opset : proto.opset_import()) {
    if (!opset.domain().empty() && opset.domain() != "ai.onnx") continue;
    if (opset.version() < kFirstOpset || opset.version() > kLastOpset) {
      throw InputError::expected(
          place,
          "an opset from " + std::to_string(kFirstOpset) + " to " + std::to_string(kLastOpset),
          std::to_string(opset.version()));
    }
    return static_cast<int>(opset.version());
  }
  throw InputError::expected(place, "an opset", "none");
}

::onnx::ModelProto parse(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw InputError::expected(file.string(), "an ONNX file", "no such file");
  ::onnx::ModelProto proto;
  if (!proto.ParseFromIstream(&stream) || !proto.has_graph()) {
    throw InputError::expected(file.string(), "an ONNX model", "a damaged or other file");
  }
  return proto;
}

}  // namespace

std::string Node::describe() const {
  return "node '" + name + "' (" + op_type + ", opset " + std::to_string(opset) + ")";
}

std::shared_ptr<const Model> read_model(const fs::path& file) {
  const ::onnx::ModelProto proto = parse(file);
  if (proto.functions_size() > 0) {
    throw InputError::expected(file.string(), "a model without local functions",
                               proto.functions(0).name() + "; export without functions");
  }
  const Source source{file.string(), file.parent_path(), opset_of(proto, file.string())};
  auto model = std::make_shared<Model>();
  model->place = source.place;
  model->graph = Builder(source, nullptr, 0).build(proto.graph());
  std::map<std::string, TensorInfo> declared;
  for (const auto& input : proto.graph().input()) declared[input.name()] = info_of(input);
  for (const Slot slot : model->graph.inputs) {
    const TensorInfo& info = declared.at(model->graph.slot_names[slot]);
    if (info.type.empty()) {
      throw InputError::expected(source.place + ": input '" + info.name + "'", "a tensor",
                                 "another value");
    }
    model->inputs.push_back(info);
  }
  for (const auto& input : proto.graph().input()) {
    for (const TensorInfo& info : model->inputs) {
      if (info.name != input.name()) continue;
      model->input_types.push_back(scalar_type(input.type().tensor_type().elem_type(),
                                               source.place + ": input '" + info.name + "'"));
    }
  }
  for (const auto& output : proto.graph().output()) model->outputs.push_back(info_of(output));
  for (const auto& entry : proto.metadata_props()) {
    model->metadata[entry.key()] = entry.value();
  }
  fold_constants(model->graph, model->place);
  return model;
}

}  // namespace segsim::perception::graph
