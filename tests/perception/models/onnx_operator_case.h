#pragma once

/// @file
/// One ONNX node, run twice: on inputs of the run, and on constants that are folded at load.

#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "perception/models/model_session.h"
#include "tests/perception/onnx_builder.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {

inline HostTensor real(const Ints& shape, const Floats& values) { return {shape, values}; }
inline HostTensor whole(const Ints& shape, const Ints& values) { return {shape, values}; }

struct OperatorCase {
  std::string op;
  std::vector<HostTensor> inputs;  ///< An empty shape and no numbers: left out.
  std::function<void(NodeBuilder&)> attributes{};
  std::int64_t opset = 17;
  std::size_t outputs = 1;
  std::map<std::size_t, int> types{};  ///< ONNX type of an input, if not float or int64.
};

inline bool left_out(const HostTensor& tensor) {
  return tensor.shape.empty() && std::holds_alternative<Floats>(tensor.values) &&
         tensor.floats().empty();
}

/// @param folded  Whether inputs are constants of the graph.
inline std::vector<HostTensor> run_operator(const OperatorCase& test, bool folded) {
  const tests::TemporaryFolder folder;
  GraphBuilder builder(test.opset);
  Names inputs, outputs;
  std::map<std::string, HostTensor> given;
  for (std::size_t i = 0; i < test.inputs.size(); ++i) {
    const HostTensor& tensor = test.inputs[i];
    const std::string name = left_out(tensor) ? "" : "x" + std::to_string(i);
    inputs.push_back(name);
    if (name.empty()) continue;
    const bool is_real = std::holds_alternative<Floats>(tensor.values);
    const auto type = test.types.contains(i) ? test.types.at(i)
                      : is_real              ? kFloatType
                                             : kInt64Type;
    if (!folded) {
      builder.input(name, tensor.shape, type);
      given[name] = tensor;
    } else if (type != kFloatType && type != kInt64Type) {
      builder.constant(name + "_64", is_real ? float_tensor(tensor.shape, tensor.floats())
                                             : int_tensor(tensor.shape, tensor.integers()));
      builder.node("Cast", {name + "_64"}, {name}).with("to", type);
    } else {
      builder.constant(name, is_real ? float_tensor(tensor.shape, tensor.floats())
                                     : int_tensor(tensor.shape, tensor.integers()));
    }
  }
  for (std::size_t i = 0; i < test.outputs; ++i) outputs.push_back("y" + std::to_string(i));
  NodeBuilder node = builder.node(test.op, inputs, outputs);
  if (test.attributes) test.attributes(node);
  for (const auto& name : outputs) builder.output(name);
  builder.save(folder / "model.onnx");
  std::vector<HostTensor> results;
  for (ModelOutput& output : open_model(folder / "model.onnx")->run(given)) {
    results.push_back(std::move(output.tensor));
  }
  return results;
}

inline void expect_near(const HostTensor& found, const HostTensor& expected, float tolerance) {
  ASSERT_EQ(found.shape, expected.shape);
  ASSERT_EQ(found.values.index(), expected.values.index());
  if (std::holds_alternative<Ints>(found.values)) {
    EXPECT_EQ(found.integers(), expected.integers());
    return;
  }
  ASSERT_EQ(found.floats().size(), expected.floats().size());
  for (std::size_t i = 0; i < found.floats().size(); ++i) {
    EXPECT_NEAR(found.floats()[i], expected.floats()[i], tolerance) << "at " << i;
  }
}

inline void expect_results(const OperatorCase& test, const std::vector<HostTensor>& expected,
                           float tolerance = 1e-5F) {
  for (const bool folded : {false, true}) {
    SCOPED_TRACE(test.op + (folded ? ", folded" : ""));
    const auto results = run_operator(test, folded);
    ASSERT_EQ(results.size(), expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) {
      expect_near(results[i], expected[i], tolerance);
    }
  }
}

}  // namespace segsim::perception
