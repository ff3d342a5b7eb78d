// Whole ONNX files: subgraphs, constants, data beside the file, and everything that can be
// wrong.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "core/random.h"
#include "tests/perception/models/onnx_operator_case.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using testing::HasSubstr;

/// The message that opening (and running on `inputs`) throws; "" if nothing is thrown.
std::string message_of(const GraphBuilder& builder,
                       const std::map<std::string, HostTensor>& inputs = {},
                       bool runs = false) {
  const tests::TemporaryFolder folder;
  builder.save(folder / "model.onnx");
  try {
    const auto session = open_model(folder / "model.onnx");
    if (runs) (void)session->run(inputs);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "";
}

HostTensor run_one(const GraphBuilder& builder,
                   const std::map<std::string, HostTensor>& inputs) {
  const tests::TemporaryFolder folder;
  builder.save(folder / "model.onnx");
  return open_model(folder / "model.onnx")->run(inputs).at(0).tensor;
}

GraphBuilder relu_graph(std::int64_t opset = 17) {
  GraphBuilder builder(opset);
  builder.input("x", {-1});
  builder.node("Relu", {"x"}, {"y"});
  builder.output("y");
  return builder;
}

TEST(OnnxModel, SaysWhatItIs) {
  const tests::TemporaryFolder folder;
  GraphBuilder builder = relu_graph();
  builder.metadata("names", "{0: 'chair'}");
  builder.save(folder / "model.bin");  // The extension does not matter.
  const auto session = open_model(folder / "model.bin");
  EXPECT_EQ(session->inputs().at(0).describe(), "x float [-1]");
  EXPECT_EQ(session->outputs().at(0).name, "y");
  EXPECT_EQ(session->metadata().at("names"), "{0: 'chair'}");
}

TEST(OnnxModel, NamesTheNodeThatIsNotSupported) {
  GraphBuilder builder = relu_graph();
  builder.graph().mutable_node(0)->set_op_type("FancyLoss");
  EXPECT_THAT(message_of(builder), HasSubstr("node 'Relu_1' (FancyLoss, opset 17)"));

  GraphBuilder domain = relu_graph();
  domain.graph().mutable_node(0)->set_domain("com.example");
  EXPECT_THAT(message_of(domain), HasSubstr("Relu of domain com.example"));

  GraphBuilder attribute(17);
  attribute.input("x", {-1});
  attribute.node("Relu", {"x"}, {"y"}).with("slope", 2);
  attribute.output("y");
  EXPECT_THAT(message_of(attribute), HasSubstr("attribute 'slope'"));

  GraphBuilder old(17);  // Upsample ended with opset 9.
  old.input("x", {1, 1, 1, 1});
  old.floats("s", {4}, {1, 1, 2, 2});
  old.node("Upsample", {"x", "s"}, {"y"});
  old.output("y");
  EXPECT_THAT(message_of(old), HasSubstr("expected Upsample of opset 7 to 9, found 17"));

  EXPECT_THAT(message_of(relu_graph(99)),
              HasSubstr("expected an opset from 7 to 22, found 99"));
}

TEST(OnnxModel, RefusesBrokenGraphs) {
  GraphBuilder dangling = relu_graph();
  dangling.graph().mutable_node(0)->set_input(0, "nobody");
  EXPECT_THAT(message_of(dangling), HasSubstr("'nobody' to be made by a node before it"));

  GraphBuilder twice = relu_graph();
  twice.node("Relu", {"x"}, {"y"});
  EXPECT_THAT(message_of(twice), HasSubstr("each value made once"));

  GraphBuilder short_data = relu_graph();
  ::onnx::TensorProto tensor = float_tensor({4}, {1, 2});
  short_data.constant("w", tensor);
  EXPECT_THAT(message_of(short_data), HasSubstr("expected 16 bytes for float [4], found 8"));

  GraphBuilder text = relu_graph();
  tensor = float_tensor({}, {});
  tensor.set_data_type(::onnx::TensorProto::STRING);
  text.constant("w", tensor);
  EXPECT_THAT(message_of(text), HasSubstr("type 8, which is not supported"));

  GraphBuilder huge = relu_graph();
  tensor = float_tensor({}, {});
  tensor.add_dims(std::int64_t{1} << 40);
  huge.constant("w", tensor);
  EXPECT_THAT(message_of(huge), HasSubstr("at most 2^30 elements"));
}

TEST(OnnxModel, ChecksWhatItIsGiven) {
  const GraphBuilder builder = relu_graph();
  EXPECT_THAT(message_of(builder, {}, true),
              HasSubstr("input 'x': expected a tensor, found none"));
  EXPECT_THAT(message_of(builder, {{"x", real({1, 1}, {1})}}, true),
              HasSubstr("expected [-1] (-1: any), found [1, 1]"));
  EXPECT_THAT(message_of(builder, {{"x", real({1}, {1})}, {"z", real({1}, {1})}}, true),
              HasSubstr("found 'z'"));
  EXPECT_THAT(message_of(builder, {{"x", real({3}, {1})}}, true),
              HasSubstr("expected 3 numbers for [3], found 1"));
}

TEST(OnnxModel, HalfAndSmallIntegersAreComputedWider) {
  GraphBuilder builder(17);
  ::onnx::TensorProto half;
  half.set_data_type(::onnx::TensorProto::FLOAT16);
  half.add_dims(2);
  for (const int bits : {0x3C00, 0xC100}) half.add_int32_data(bits);  // 1, -2.5
  builder.constant("h", half);
  builder.input("x", {2}, ::onnx::TensorProto::FLOAT16);
  builder.node("Add", {"x", "h"}, {"y"});
  builder.output("y");
  expect_near(run_one(builder, {{"x", real({2}, {1, 1})}}), real({2}, {2, -1.5F}), 0);
}

/// sum = x; for (i < trips) sum += step, and lists the sums.
GraphBuilder summing_loop(const Names& loop_inputs) {
  ::onnx::GraphProto body;
  body.set_name("body");
  for (const char* name : {"i", "go", "sum"}) {
    auto* info = body.add_input();
    info->set_name(name);
    info->mutable_type()->mutable_tensor_type()->set_elem_type(kInt64Type);
  }
  auto* add = body.add_node();
  add->set_op_type("Add");
  add->add_input("sum");
  add->add_input("step");  // Of the graph around.
  add->add_output("next");
  auto* same = body.add_node();
  same->set_op_type("Identity");
  same->add_input("go");
  same->add_output("go_on");
  for (const char* name : {"go_on", "next", "next"}) body.add_output()->set_name(name);

  GraphBuilder builder(17);
  builder.input("trips", {}, kInt64Type);
  builder.input("x", {}, kInt64Type);
  builder.input("two", {}, kInt64Type);
  builder.node("Mul", {"two", "two"}, {"step"});
  builder.node("Loop", loop_inputs, {"last", "all"}).with("body", body);
  builder.output("all", kInt64Type);
  builder.output("last", kInt64Type);
  return builder;
}

const std::map<std::string, HostTensor> kLoopInputs{
    {"trips", whole({}, {3})}, {"x", whole({}, {10})}, {"two", whole({}, {2})}};

TEST(OnnxModel, LoopCarriesStateAndSeesTheGraphAround) {
  const tests::TemporaryFolder folder;
  summing_loop({"trips", "", "x"}).save(folder / "model.onnx");
  const auto outputs = open_model(folder / "model.onnx")->run(kLoopInputs);
  EXPECT_EQ(outputs[0].tensor.integers(), (Ints{14, 18, 22}));
  EXPECT_EQ(outputs[1].tensor.integers(), Ints{22});
}

TEST(OnnxModel, LoopWithMoreOrFewerInputsThanItsBodyIsNamed) {
  for (const Names& inputs : {Names{"trips", ""}, Names{"trips", "", "x", "two"}}) {
    EXPECT_THAT(message_of(summing_loop(inputs), kLoopInputs, true),
                HasSubstr("expected 3 inputs, as the body carries 1 values"));
  }
}

TEST(OnnxModel, IfTakesOneBranch) {
  const auto branch = [](const std::string& op) {
    ::onnx::GraphProto graph;
    graph.set_name(op);
    auto* node = graph.add_node();
    node->set_op_type(op);
    node->add_input("x");
    node->add_output(op + "_out");
    graph.add_output()->set_name(op + "_out");
    return graph;
  };
  GraphBuilder builder(17);
  builder.input("x", {-1});
  builder.input("c", {}, ::onnx::TensorProto::BOOL);
  builder.node("If", {"c"}, {"y"})
      .with("then_branch", branch("Neg"))
      .with("else_branch", branch("Relu"));
  builder.output("y");
  const auto x = real({2}, {-1, 3});
  EXPECT_EQ(run_one(builder, {{"x", x}, {"c", whole({}, {1})}}).floats(), (Floats{1, -3}));
  EXPECT_EQ(run_one(builder, {{"x", x}, {"c", whole({}, {0})}}).floats(), (Floats{0, 3}));
}

TEST(OnnxModel, ListsOfTensors) {
  GraphBuilder builder(17);
  builder.input("x", {-1});
  builder.node("Neg", {"x"}, {"n"});
  builder.node("SequenceConstruct", {"x", "n"}, {"list"});
  builder.node("ConcatFromSequence", {"list"}, {"y"}).with("axis", 0).with("new_axis", 1);
  builder.output("y");
  const HostTensor y = run_one(builder, {{"x", real({2}, {1, 2})}});
  EXPECT_EQ(y.shape, (Ints{2, 2}));
  EXPECT_EQ(y.floats(), (Floats{1, 2, -1, -2}));
}

class ExternalData : public testing::Test {
 protected:
  /// w = four numbers at byte 4 of another file.
  GraphBuilder graph(const std::string& location, const std::string& offset = "4",
                     const std::string& length = "16") {
    GraphBuilder builder(17);
    ::onnx::TensorProto tensor;
    tensor.set_data_type(kFloatType);
    tensor.add_dims(4);
    tensor.set_data_location(::onnx::TensorProto::EXTERNAL);
    for (const auto& [key, value] :
         {std::pair{"location", location}, {"offset", offset}, {"length", length}}) {
      auto* entry = tensor.add_external_data();
      entry->set_key(key);
      entry->set_value(value);
    }
    builder.constant("w", tensor);
    builder.input("x", {4});
    builder.node("Add", {"x", "w"}, {"y"});
    builder.output("y");
    return builder;
  }

  std::string message(const GraphBuilder& builder) {
    builder.save(folder_ / "model/model.onnx");
    try {
      (void)open_model(folder_ / "model/model.onnx");
    } catch (const core::InputError& error) {
      return error.what();
    }
    return "";
  }

  void SetUp() override {
    const Floats numbers{99, 1, 2, 3, 4};
    const std::string bytes(reinterpret_cast<const char*>(numbers.data()), 20);
    for (const char* place : {"model/w.data", "secret.data"}) {
      core::write_file_atomically(folder_ / place, [&](std::ostream& out) { out << bytes; });
    }
  }

  tests::TemporaryFolder folder_;
};

TEST_F(ExternalData, IsReadFromItsOffset) {
  EXPECT_EQ(message(graph("w.data")), "");
  const auto y =
      open_model(folder_ / "model/model.onnx")->run({{"x", real({4}, {1, 1, 1, 1})}});
  EXPECT_EQ(y[0].tensor.floats(), (Floats{2, 3, 4, 5}));
}

TEST_F(ExternalData, StaysInTheFolderOfTheModel) {
  const std::string refused = "external data in the folder of the model";
  EXPECT_THAT(message(graph("../secret.data")), HasSubstr(refused));
  EXPECT_THAT(message(graph((folder_ / "secret.data").string())), HasSubstr(refused));
  EXPECT_THAT(message(graph("")), HasSubstr(refused));
  EXPECT_THAT(message(graph(".")), HasSubstr(refused));
  std::filesystem::create_symlink(folder_ / "secret.data", folder_ / "model/link.data");
  EXPECT_THAT(message(graph("link.data")), HasSubstr(refused));
}

TEST_F(ExternalData, StaysInsideTheFile) {
  EXPECT_THAT(message(graph("none.data")), HasSubstr("no such file"));
  EXPECT_THAT(message(graph("w.data", "8")), HasSubstr("a file of 20"));
  EXPECT_THAT(message(graph("w.data", "4", "12")), HasSubstr("a length of 12"));
  EXPECT_THAT(message(graph("w.data", "-4")), HasSubstr("a count of bytes"));
}

/// A graph with most kinds of attribute, so that damage has much to hit.
GraphBuilder varied_graph() {
  GraphBuilder builder(17);
  builder.input("x", {1, 2, 6, 6});
  builder.floats("k", {2, 2, 3, 3}, Floats(36, 0.1F));
  builder.node("Conv", {"x", "k"}, {"a"})
      .with("pads", Ints{1, 1, 1, 1})
      .with("strides", Ints{2, 2});
  builder.node("MaxPool", {"a"}, {"b"}).with("kernel_shape", Ints{2, 2});
  builder.floats("scales", {4}, {1, 1, 2, 2});
  builder.node("Resize", {"b", "", "scales"}, {"c"}).with("mode", std::string("linear"));
  builder.ints("shape", {1, 2, -1});
  builder.node("Reshape", {"c", "shape"}, {"d"});
  builder.ints("pads", {0, 0, 1, 0, 0, 1});
  builder.node("Pad", {"d", "pads"}, {"e"});
  builder.node("Softmax", {"e"}, {"f"}).with("axis", -1);
  builder.ints("first", {0});
  builder.node("Gather", {"f", "first"}, {"g"}).with("axis", 1);
  builder.node("ReduceMean", {"g"}, {"y"}).with("axes", Ints{2});
  builder.output("y");
  return builder;
}

TEST(OnnxDamage, EveryTruncationAndManyFlipsAreErrorsOrRun) {
  const std::string bytes = varied_graph().model.SerializeAsString();
  const tests::TemporaryFolder folder;
  const std::filesystem::path file = folder / "model.onnx";
  const HostTensor x = real({1, 2, 6, 6}, Floats(72, 1));
  int errors = 0, runs = 0;
  const auto attempt = [&](const std::string& damaged) {
    core::write_file_atomically(file, [&](std::ostream& out) { out << damaged; });
    try {
      const auto session = open_model(file);
      std::map<std::string, HostTensor> inputs;
      for (const TensorInfo& info : session->inputs()) inputs[info.name] = x;
      (void)session->run(inputs);
      ++runs;
    } catch (const core::InputError&) {
      ++errors;
    }
  };
  for (std::size_t length = 0; length < bytes.size(); length += 7)
    attempt(bytes.substr(0, length));
  core::RandomStream random(1, "onnx damage");
  for (int i = 0; i < 600; ++i) {
    std::string damaged = bytes;
    const std::size_t at = random.index(static_cast<std::uint32_t>(bytes.size()));
    damaged[at] = static_cast<char>(damaged[at] ^ (1U << random.index(8)));
    attempt(damaged);
  }
  attempt(bytes);
  EXPECT_GT(errors, 100);
  EXPECT_GT(runs, 10);
}

TEST(OnnxDamage, OtherFilesAreRefused) {
  const tests::TemporaryFolder folder;
  EXPECT_THROW((void)open_model(folder / "none.onnx"), core::InputError);
  EXPECT_THROW((void)open_model(folder / ""), core::InputError);
  for (const std::string& text :
       {std::string(), std::string("hello"), std::string(64, '\0')}) {
    core::write_file_atomically(folder / "x.onnx", [&](std::ostream& out) { out << text; });
    EXPECT_THROW((void)open_model(folder / "x.onnx"), core::InputError);
  }
}

}  // namespace
}  // namespace segsim::perception
