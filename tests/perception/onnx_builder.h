#pragma once

/// @file
/// Writes ONNX files for tests, as exporters do.

#include <onnx/onnx_pb.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "perception/models/model_session.h"

namespace segsim::perception {

using Ints = std::vector<std::int64_t>;
using Floats = std::vector<float>;
using Names = std::vector<std::string>;

inline constexpr int kFloatType = ::onnx::TensorProto::FLOAT;
inline constexpr int kInt64Type = ::onnx::TensorProto::INT64;

inline ::onnx::TensorProto float_tensor(const Ints& shape, const Floats& values) {
  ::onnx::TensorProto tensor;
  tensor.set_data_type(kFloatType);
  for (const auto side : shape) tensor.add_dims(side);
  tensor.set_raw_data(values.data(), values.size() * sizeof(float));
  return tensor;
}

inline ::onnx::TensorProto int_tensor(const Ints& shape, const Ints& values) {
  ::onnx::TensorProto tensor;
  tensor.set_data_type(kInt64Type);
  for (const auto side : shape) tensor.add_dims(side);
  for (const auto value : values) tensor.add_int64_data(value);
  return tensor;
}

/// A node whose attributes are added one by one.
class NodeBuilder {
 public:
  explicit NodeBuilder(::onnx::NodeProto* node) : node_(node) {}
  NodeBuilder& with(const std::string& name, std::int64_t value) {
    auto* a = attribute(name, ::onnx::AttributeProto::INT);
    a->set_i(value);
    return *this;
  }
  NodeBuilder& with(const std::string& name, int value) {
    return with(name, std::int64_t{value});
  }
  NodeBuilder& with(const std::string& name, float value) {
    attribute(name, ::onnx::AttributeProto::FLOAT)->set_f(value);
    return *this;
  }
  NodeBuilder& with(const std::string& name, const std::string& value) {
    attribute(name, ::onnx::AttributeProto::STRING)->set_s(value);
    return *this;
  }
  NodeBuilder& with(const std::string& name, const Ints& values) {
    auto* a = attribute(name, ::onnx::AttributeProto::INTS);
    for (const auto value : values) a->add_ints(value);
    return *this;
  }
  NodeBuilder& with(const std::string& name, const ::onnx::TensorProto& value) {
    *attribute(name, ::onnx::AttributeProto::TENSOR)->mutable_t() = value;
    return *this;
  }
  NodeBuilder& with(const std::string& name, const ::onnx::GraphProto& value) {
    *attribute(name, ::onnx::AttributeProto::GRAPH)->mutable_g() = value;
    return *this;
  }

 private:
  ::onnx::AttributeProto* attribute(const std::string& name,
                                    ::onnx::AttributeProto::AttributeType type) {
    auto* a = node_->add_attribute();
    a->set_name(name);
    a->set_type(type);
    return a;
  }
  ::onnx::NodeProto* node_;
};

class GraphBuilder {
 public:
  explicit GraphBuilder(std::int64_t opset = 17) {
    model.set_ir_version(8);
    model.add_opset_import()->set_version(opset);
  }

  void input(const std::string& name, const Ints& shape, int type = kFloatType) {
    declare(graph().add_input(), name, shape, type);
  }
  void output(const std::string& name, int type = kFloatType) {
    auto* info = graph().add_output();
    info->set_name(name);
    info->mutable_type()->mutable_tensor_type()->set_elem_type(type);
  }
  std::string constant(const std::string& name, ::onnx::TensorProto tensor) {
    tensor.set_name(name);
    *graph().add_initializer() = std::move(tensor);
    return name;
  }
  std::string floats(const std::string& name, const Ints& shape, const Floats& values) {
    return constant(name, float_tensor(shape, values));
  }
  std::string ints(const std::string& name, const Ints& values) {
    return constant(name, int_tensor({static_cast<std::int64_t>(values.size())}, values));
  }
  NodeBuilder node(const std::string& op, const Names& inputs, const Names& outputs) {
    auto* node = graph().add_node();
    node->set_op_type(op);
    node->set_name(op + "_" + std::to_string(graph().node_size()));
    for (const auto& name : inputs) node->add_input(name);
    for (const auto& name : outputs) node->add_output(name);
    return NodeBuilder(node);
  }
  void metadata(const std::string& key, const std::string& value) {
    auto* entry = model.add_metadata_props();
    entry->set_key(key);
    entry->set_value(value);
  }
  void save(const std::filesystem::path& file) const {
    std::ofstream stream(file, std::ios::binary);
    model.SerializeToOstream(&stream);
  }
  ::onnx::GraphProto& graph() { return *model.mutable_graph(); }

  ::onnx::ModelProto model;

 private:
  static void declare(::onnx::ValueInfoProto* info, const std::string& name, const Ints& shape,
                      int type) {
    info->set_name(name);
    auto* tensor = info->mutable_type()->mutable_tensor_type();
    tensor->set_elem_type(type);
    auto* sides = tensor->mutable_shape();
    for (const auto side : shape) {
      auto* dim = sides->add_dim();
      if (side >= 0) {
        dim->set_dim_value(side);
      } else {
        dim->set_dim_param("n");
      }
    }
  }
};

}  // namespace segsim::perception
