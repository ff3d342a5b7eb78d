// ONNX models: read, checked, their constants folded (perception/models/model_session.h).
#include "core/error.h"
#include "perception/models/model_session.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/perception/onnx_builder.h"

namespace segsim::fuzz {
namespace {

std::string saved(const perception::GraphBuilder& builder) {
  return written([&](const auto& file) { builder.save(file); }, "model.onnx");
}

std::string plain_graph() {
  perception::GraphBuilder builder;
  builder.input("x", {-1, 3});
  builder.floats("w", {3, 2}, {1, 2, 3, 4, 5, 6});
  builder.node("MatMul", {"x", "w"}, {"z"});
  builder.node("Relu", {"z"}, {"y"});
  builder.output("y");
  builder.metadata("names", "{0: 'chair'}");
  return saved(builder);
}

/// Whose constants are computed while it is read.
std::string folded_graph() {
  perception::GraphBuilder builder;
  builder.input("x", {2, 3});
  builder.ints("shape", {3, 2});
  builder.ints("starts", {0});
  builder.ints("ends", {1});
  builder.floats("c", {1, 6}, {1, 2, 3, 4, 5, 6});
  builder.node("Reshape", {"c", "shape"}, {"r"}).with("allowzero", 0);
  builder.node("Transpose", {"r"}, {"t"}).with("perm", perception::Ints{1, 0});
  builder.node("Slice", {"t", "starts", "ends"}, {"s"});
  builder.node("Concat", {"s", "s"}, {"k"}).with("axis", 0);
  builder.node("Add", {"x", "k"}, {"y"});
  builder.output("y");
  return saved(builder);
}

}  // namespace

void parse(const std::string& bytes) {
  (void)perception::open_model(in_file(bytes, "model.onnx"))->inputs();
}

std::vector<std::string> seeds() { return {plain_graph(), folded_graph()}; }

}  // namespace segsim::fuzz
