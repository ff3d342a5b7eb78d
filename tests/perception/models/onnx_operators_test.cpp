// Operators of the ONNX executor against results worked out by hand from the standard. The
// standard's own node tests run in onnx_node_suite_test.cpp where they are at hand.
#include <gmock/gmock.h>

#include <cmath>

#include "core/error.h"
#include "tests/error_message.h"
#include "tests/perception/models/onnx_operator_case.h"

namespace segsim::perception {
namespace {

const HostTensor kNothing = real({}, {});

TEST(OnnxElementwise, Arithmetic) {
  const auto a = real({3}, {7, -7, 2}), b = real({}, {2});
  expect_results({"Add", {a, b}}, {real({3}, {9, -5, 4})});
  expect_results({"Sub", {a, b}}, {real({3}, {5, -9, 0})});
  expect_results({"Mul", {a, b}}, {real({3}, {14, -14, 4})});
  expect_results({"Div", {a, b}}, {real({3}, {3.5F, -3.5F, 1})});
  expect_results({"Pow", {real({2}, {3, 4}), whole({}, {2})}}, {real({2}, {9, 16})});
  expect_results({"Max", {a, b, real({3}, {0, 1, 9})}}, {real({3}, {7, 2, 9})});
  expect_results({"Sum", {a, a}}, {real({3}, {14, -14, 4})});
}

TEST(OnnxElementwise, IntegersDivideTowardsZeroAndModuloHasTwoRules) {
  const auto a = whole({4}, {7, -7, 7, -7}), b = whole({4}, {2, 2, -2, -1});
  expect_results({"Div", {a, b}}, {whole({4}, {3, -3, -3, 7})});
  expect_results({"Mod", {a, b}}, {whole({4}, {1, 1, -1, 0})});
  expect_results({"Mod", {a, b}, [](NodeBuilder& n) { n.with("fmod", 1); }},
                 {whole({4}, {1, -1, 1, 0})});
}

TEST(OnnxElementwise, LowestIntegerByMinusOneDoesNotTrap) {
  const std::int64_t lowest = std::numeric_limits<std::int64_t>::min();
  expect_results({"Div", {whole({1}, {lowest}), whole({1}, {-1})}}, {whole({1}, {lowest})});
}

TEST(OnnxElementwise, HighestUnsignedIntegerIsNotMinusOne) {
  constexpr int kUint8Type = 2;
  OperatorCase test{"Div", {whole({2}, {254, 10}), whole({2}, {255, 3})}};
  test.types = {{0, kUint8Type}, {1, kUint8Type}};
  expect_results(test, {whole({2}, {0, 3})});
  test.op = "Mod";
  expect_results(test, {whole({2}, {254, 1})});
}

TEST(OnnxElementwise, DivisionOfIntegersByZeroIsAnError) {
  EXPECT_THROW(run_operator({"Div", {whole({1}, {1}), whole({1}, {0})}}, false),
               core::InputError);
}

TEST(OnnxElementwise, ActivationsAtKnownPlaces) {
  const auto x = real({3}, {-1, 0, 2});
  const float e1 = std::exp(-1.0F);
  expect_results({"Relu", {x}}, {real({3}, {0, 0, 2})});
  expect_results({"LeakyRelu", {x}, [](NodeBuilder& n) { n.with("alpha", 0.1F); }},
                 {real({3}, {-0.1F, 0, 2})});
  expect_results({"Sigmoid", {x}},
                 {real({3}, {e1 / (1 + e1), 0.5F, 1 / (1 + std::exp(-2.0F))})});
  expect_results({"Erf", {x}}, {real({3}, {std::erf(-1.0F), 0, std::erf(2.0F)})});
  expect_results({"Gelu", {x}, [](NodeBuilder&) {}, 20},
                 {real({3}, {-0.5F * (1 + std::erf(-std::sqrt(0.5F))), 0,
                             1 + std::erf(std::sqrt(2.0F))})});
  expect_results({"HardSigmoid", {x}}, {real({3}, {0.3F, 0.5F, 0.9F})});
  expect_results({"HardSwish", {x}}, {real({3}, {-1.0F / 3, 0, 5.0F / 3})});
  expect_results({"Softplus", {real({2}, {0, 100})}}, {real({2}, {std::log(2.0F), 100})});
  expect_results({"PRelu", {x, real({1}, {0.5F})}}, {real({3}, {-0.5F, 0, 2})});
  expect_results({"Round", {real({4}, {0.5F, 1.5F, -2.5F, 0.6F})}},
                 {real({4}, {0, 2, -2, 1})});
}

TEST(OnnxElementwise, ComparisonsAndConversions) {
  const auto a = real({3}, {1, 2, 3}), b = real({1}, {2});
  expect_results({"Greater", {a, b}}, {whole({3}, {0, 0, 1})});
  expect_results({"LessOrEqual", {a, b}}, {whole({3}, {1, 1, 0})});
  expect_results(
      {"Where", {whole({3}, {1, 0, 1}), a, b}, {}, 17, 1, {{0, ::onnx::TensorProto::BOOL}}},
      {real({3}, {1, 2, 3})});
  expect_results({"Cast",
                  {real({3}, {1.9F, -1.9F, 0})},
                  [](NodeBuilder& n) { n.with("to", kInt64Type); }},
                 {whole({3}, {1, -1, 0})});
  expect_results({"Clip", {a, real({}, {1.5F}), real({}, {2.5F})}},
                 {real({3}, {1.5F, 2, 2.5F})});
  expect_results({"Clip", {a, kNothing, real({}, {2.5F})}}, {real({3}, {1, 2, 2.5F})});
  expect_results({"Clip", {a}, [](NodeBuilder& n) { n.with("min", 2.0F); }, 6 + 1},
                 {real({3}, {2, 2, 3})});
}

TEST(OnnxShape, ReshapeCopiesAndInfers) {
  const auto x = real({2, 3}, {1, 2, 3, 4, 5, 6});
  expect_results({"Reshape", {x, whole({3}, {0, -1, 1})}}, {real({2, 3, 1}, x.floats())});
  expect_results(
      {"Flatten", {real({2, 1, 3}, x.floats())}, [](NodeBuilder& n) { n.with("axis", 2); }},
      {real({2, 3}, x.floats())});
  expect_results({"Shape", {x}}, {whole({2}, {2, 3})});
  expect_results({"Shape", {x}, [](NodeBuilder& n) { n.with("start", -1); }},
                 {whole({1}, {3})});
  expect_results({"Transpose", {x}}, {real({3, 2}, {1, 4, 2, 5, 3, 6})});
  expect_results({"Unsqueeze", {x, whole({2}, {0, -1})}}, {real({1, 2, 3, 1}, x.floats())});
  expect_results({"Squeeze", {real({1, 2, 1, 3}, x.floats()), whole({1}, {0})}},
                 {real({2, 1, 3}, x.floats())});
}

TEST(OnnxShape, SliceForwardsAndBackwards) {
  const auto x = real({5}, {0, 1, 2, 3, 4});
  const auto slice = [&](std::int64_t start, std::int64_t end, std::int64_t step) {
    return OperatorCase{
        "Slice",
        {x, whole({1}, {start}), whole({1}, {end}), whole({1}, {0}), whole({1}, {step})}};
  };
  expect_results(slice(1, 4, 2), {real({2}, {1, 3})});
  expect_results(slice(-3, 100, 1), {real({3}, {2, 3, 4})});
  expect_results(slice(-1, std::numeric_limits<std::int64_t>::min(), -2),
                 {real({3}, {4, 2, 0})});
  expect_results(slice(4, 4, 1), {real({0}, {})});
  EXPECT_THROW(run_operator(slice(0, 1, 0), false), core::InputError);
}

TEST(OnnxShape, ConcatSplitTilePadExpand) {
  const auto a = real({1, 2}, {1, 2}), b = real({2, 2}, {3, 4, 5, 6});
  expect_results({"Concat", {a, b}, [](NodeBuilder& n) { n.with("axis", 0); }},
                 {real({3, 2}, {1, 2, 3, 4, 5, 6})});
  expect_results({"Split", {real({5}, {1, 2, 3, 4, 5}), whole({2}, {2, 3})}, {}, 17, 2},
                 {real({2}, {1, 2}), real({3}, {3, 4, 5})});
  expect_results({"Split",
                  {real({5}, {1, 2, 3, 4, 5})},
                  [](NodeBuilder& n) { n.with("num_outputs", 2); },
                  18,
                  2},
                 {real({3}, {1, 2, 3}), real({2}, {4, 5})});
  expect_results({"Tile", {a, whole({2}, {2, 2})}}, {real({2, 4}, {1, 2, 1, 2, 1, 2, 1, 2})});
  expect_results({"Expand", {a, whole({2}, {2, 1})}}, {real({2, 2}, {1, 2, 1, 2})});
  const auto line = real({3}, {1, 2, 3});
  expect_results({"Pad", {line, whole({2}, {1, 2}), real({}, {9})}},
                 {real({6}, {9, 1, 2, 3, 9, 9})});
  expect_results({"Pad",
                  {line, whole({2}, {2, 1})},
                  [](NodeBuilder& n) { n.with("mode", std::string("reflect")); }},
                 {real({6}, {3, 2, 1, 2, 3, 2})});
  expect_results({"Pad",
                  {line, whole({2}, {1, -1})},
                  [](NodeBuilder& n) { n.with("mode", std::string("edge")); }},
                 {real({3}, {1, 1, 2})});
}

TEST(OnnxShape, GeneratorsOfNumbers) {
  expect_results({"Range", {whole({}, {1}), whole({}, {8}), whole({}, {3})}},
                 {whole({3}, {1, 4, 7})});
  expect_results({"ConstantOfShape",
                  {whole({2}, {1, 2})},
                  [](NodeBuilder& n) { n.with("value", int_tensor({1}, {5})); }},
                 {whole({1, 2}, {5, 5})});
  expect_results({"Trilu", {real({2, 2}, {1, 2, 3, 4})}}, {real({2, 2}, {1, 2, 0, 4})});
  EXPECT_THROW(run_operator({"ConstantOfShape", {whole({2}, {1 << 20, 1 << 20})}}, false),
               core::InputError);
  EXPECT_THROW(
      run_operator({"Range", {whole({}, {0}), whole({}, {5}), whole({}, {0})}}, false),
      core::InputError);
}

TEST(OnnxIndex, GatherAndScatter) {
  const auto x = real({3, 2}, {0, 1, 10, 11, 20, 21});
  expect_results({"Gather", {x, whole({2}, {-1, 0})}}, {real({2, 2}, {20, 21, 0, 1})});
  expect_results({"Gather", {x, whole({}, {1})}, [](NodeBuilder& n) { n.with("axis", 1); }},
                 {real({3}, {1, 11, 21})});
  expect_results({"GatherElements", {x, whole({1, 2}, {2, -2})}}, {real({1, 2}, {20, 11})});
  expect_results({"GatherND", {x, whole({2, 2}, {0, 1, 2, -2})}}, {real({2}, {1, 20})});
  expect_results({"GatherND",
                  {real({2, 2, 2}, {0, 1, 2, 3, 4, 5, 6, 7}), whole({2, 1}, {1, 0})},
                  [](NodeBuilder& n) { n.with("batch_dims", 1); }},
                 {real({2, 2}, {2, 3, 4, 5})});
  expect_results({"ScatterND", {x, whole({1, 1}, {1}), real({1, 2}, {5, 6})}},
                 {real({3, 2}, {0, 1, 5, 6, 20, 21})});
  expect_results({"ScatterND",
                  {real({3}, {1, 1, 1}), whole({3, 1}, {0, 0, -1}), real({3}, {2, 3, 4})},
                  [](NodeBuilder& n) { n.with("reduction", std::string("add")); }},
                 {real({3}, {6, 1, 5})});
  expect_results({"ScatterElements", {x, whole({1, 2}, {2, 0}), real({1, 2}, {7, 8})}},
                 {real({3, 2}, {0, 8, 10, 11, 7, 21})});
  EXPECT_THROW(run_operator({"Gather", {x, whole({1}, {3})}}, false), core::InputError);
  EXPECT_THROW(run_operator({"GatherND", {x, whole({1, 1}, {-4})}}, true), core::InputError);
}

TEST(OnnxIndex, BestOnesWithTiesByIndex) {
  const auto x = real({5}, {1, 3, 3, 2, 3});
  expect_results({"TopK", {x, whole({1}, {3})}, {}, 17, 2},
                 {real({3}, {3, 3, 3}), whole({3}, {1, 2, 4})});
  expect_results(
      {"TopK", {x, whole({1}, {2})}, [](NodeBuilder& n) { n.with("largest", 0); }, 17, 2},
      {real({2}, {1, 2}), whole({2}, {0, 3})});
  expect_results({"ArgMax",
                  {x},
                  [](NodeBuilder& n) { n.with("select_last_index", 1).with("keepdims", 0); }},
                 {whole({}, {4})});
  expect_results({"NonZero", {real({2, 2}, {0, 5, 6, 0})}}, {whole({2, 2}, {0, 1, 1, 0})});
  expect_results({"OneHot", {whole({3}, {0, -1, 7}), whole({}, {3}), real({2}, {0, 9})}},
                 {real({3, 3}, {9, 0, 0, 0, 0, 9, 0, 0, 0})});
  EXPECT_THROW(run_operator({"TopK", {x, whole({1}, {6})}, {}, 17, 2}, false),
               core::InputError);
}

TEST(OnnxReduce, AxesAsAttributeAndAsInput) {
  const auto x = real({2, 2}, {1, 2, 3, 4});
  const auto axis_one = [](NodeBuilder& n) { n.with("axes", Ints{1}).with("keepdims", 0); };
  expect_results({"ReduceSum", {x, whole({1}, {0})}}, {real({1, 2}, {4, 6})});
  expect_results({"ReduceMean", {x}, axis_one}, {real({2}, {1.5F, 3.5F})});
  expect_results({"ReduceMax", {x}, axis_one}, {real({2}, {2, 4})});
  expect_results({"ReduceProd", {x}}, {real({1, 1}, {24})});
  expect_results({"ReduceL2", {real({2}, {3, 4})}}, {real({1}, {5})});
  expect_results({"ReduceLogSumExp", {real({2}, {0, 0})}}, {real({1}, {std::log(2.0F)})});
  expect_results({"CumSum",
                  {real({3}, {1, 2, 3}), whole({}, {0})},
                  [](NodeBuilder& n) { n.with("exclusive", 1).with("reverse", 1); }},
                 {real({3}, {5, 3, 0})});
}

TEST(OnnxMatrix, ProductsAndSums) {
  const auto a = real({2, 2}, {1, 2, 3, 4}), b = real({2, 1}, {5, 6});
  expect_results({"MatMul", {a, b}}, {real({2, 1}, {17, 39})});
  expect_results(
      {"Gemm",
       {a, b, real({1}, {10})},
       [](NodeBuilder& n) { n.with("transA", 1).with("alpha", 2.0F).with("beta", 0.5F); }},
      {real({2, 1}, {2 * (5 + 18) + 5.0F, 2 * (10 + 24) + 5.0F})});
  expect_results({"Einsum",
                  {a, a},
                  [](NodeBuilder& n) { n.with("equation", std::string("ij, ij -> i")); }},
                 {real({2}, {5, 25})});
  EXPECT_THROW(run_operator({"MatMul", {a, real({3, 1}, {1, 2, 3})}}, false),
               core::InputError);
}

TEST(OnnxNorm, UnitsAndShares) {
  const auto x = real({1, 2, 1, 2}, {1, 3, 10, 30});
  const auto one = real({2}, {1, 1}), two = real({2}, {2, 2}), none = real({2}, {0, 0});
  const auto plain = [](NodeBuilder& n) { n.with("epsilon", 0.0F); };
  expect_results({"InstanceNormalization", {x, one, two}, plain},
                 {real({1, 2, 1, 2}, {1, 3, 1, 3})});
  expect_results(
      {"BatchNormalization", {x, two, one, real({2}, {1, 10}), real({2}, {4, 100})}, plain},
      {real({1, 2, 1, 2}, {1, 3, 1, 5})});
  expect_results({"LayerNormalization", {real({2, 2}, {1, 3, 10, 30}), two, one}, plain},
                 {real({2, 2}, {-1, 3, -1, 3})});
  expect_results({"GroupNormalization",
                  {x, one, none},
                  [](NodeBuilder& n) { n.with("epsilon", 0.0F).with("num_groups", 2); },
                  21},
                 {real({1, 2, 1, 2}, {-1, 1, -1, 1})});
  expect_results({"Softmax", {real({1, 2}, {0, std::log(3.0F)})}},
                 {real({1, 2}, {0.25F, 0.75F})});
  // Before opset 13 all axes from the named one on count as one.
  expect_results({"Softmax", {real({1, 2, 2}, {0, 0, 0, 0})}, {}, 11},
                 {real({1, 2, 2}, {0.25F, 0.25F, 0.25F, 0.25F})});
}

TEST(OnnxWindow, ConvolutionCountsItsNeighbours) {
  const auto ones = real({1, 1, 3, 3}, Floats(9, 1)),
             kernel = real({1, 1, 3, 3}, Floats(9, 1));
  expect_results({"Conv",
                  {ones, kernel, real({1}, {0.5F})},
                  [](NodeBuilder& n) {
                    n.with("pads", Ints{1, 1, 1, 1});
                  }},
                 {real({1, 1, 3, 3}, {4.5F, 6.5F, 4.5F, 6.5F, 9.5F, 6.5F, 4.5F, 6.5F, 4.5F})});
  expect_results({"Conv",
                  {ones, kernel},
                  [](NodeBuilder& n) {
                    n.with("pads", Ints{0, 0, 1, 1}).with("strides", Ints{2, 2});
                  }},
                 {real({1, 1, 1, 1}, {9})});
  expect_results({"Conv",
                  {ones, kernel},
                  [](NodeBuilder& n) {
                    n.with("auto_pad", std::string("SAME_UPPER")).with("strides", Ints{2, 2});
                  }},
                 {real({1, 1, 2, 2}, {4, 4, 4, 4})});
  expect_results({"Conv",
                  {real({1, 2, 3}, {1, 2, 3, 4, 5, 6}), real({2, 1, 2}, {1, 1, 1, -1})},
                  [](NodeBuilder& n) { n.with("group", 2); }},
                 {real({1, 2, 2}, {3, 5, -1, -1})});
  EXPECT_THROW(run_operator({"Conv", {ones, real({1, 2, 3, 3}, Floats(18, 1))}}, false),
               core::InputError);
  EXPECT_THROW(run_operator({"Conv", {real({1, 1, 2, 2}, Floats(4, 1)), kernel}}, false),
               core::InputError);
}

TEST(OnnxWindow, TransposedConvolutionSpreadsItsKernel) {
  const auto x = real({1, 1, 2, 2}, {1, 2, 3, 4}), kernel = real({1, 1, 2, 2}, Floats(4, 1));
  expect_results(
      {"ConvTranspose",
       {x, kernel, real({1}, {10})},
       [](NodeBuilder& n) {
         n.with("strides", Ints{2, 2});
       }},
      {real({1, 1, 4, 4}, {11, 11, 12, 12, 11, 11, 12, 12, 13, 13, 14, 14, 13, 13, 14, 14})});
  expect_results({"ConvTranspose",
                  {x, kernel},
                  [](NodeBuilder& n) {
                    n.with("pads", Ints{1, 0, 0, 1});
                  }},
                 {real({1, 1, 2, 2}, {4, 10, 3, 7})});
}

TEST(OnnxWindow, Pools) {
  const auto x = real({1, 1, 2, 3}, {1, 2, 3, 4, 5, 6});
  expect_results({"MaxPool",
                  {x},
                  [](NodeBuilder& n) {
                    n.with("kernel_shape", Ints{2, 2});
                  },
                  17,
                  2},
                 {real({1, 1, 1, 2}, {5, 6}), whole({1, 1, 1, 2}, {4, 5})});
  const auto padded = [](NodeBuilder& n) {
    n.with("kernel_shape", Ints{2, 2})
        .with("pads", Ints{1, 1, 0, 0})
        .with("strides", Ints{2, 2});
  };
  expect_results({"MaxPool", {x}, padded}, {real({1, 1, 1, 2}, {1, 3})});
  expect_results({"AveragePool", {x}, padded}, {real({1, 1, 1, 2}, {1, 2.5F})});
  expect_results({"GlobalAveragePool", {x}}, {real({1, 1, 1, 1}, {3.5F})});
}

TEST(OnnxResample, NearestAndLinear) {
  const auto x = real({1, 1, 1, 2}, {1, 3});
  const auto scales = real({4}, {1, 1, 1, 2});
  expect_results({"Resize",
                  {x, kNothing, scales},
                  [](NodeBuilder& n) {
                    n.with("coordinate_transformation_mode", std::string("asymmetric"))
                        .with("nearest_mode", std::string("floor"));
                  }},
                 {real({1, 1, 1, 4}, {1, 1, 3, 3})});
  expect_results({"Resize",
                  {x, kNothing, scales},
                  [](NodeBuilder& n) { n.with("mode", std::string("linear")); }},
                 {real({1, 1, 1, 4}, {1, 1.5F, 2.5F, 3})});
  expect_results({"Resize",
                  {x, kNothing, kNothing, whole({4}, {1, 1, 1, 3})},
                  [](NodeBuilder& n) {
                    n.with("mode", std::string("linear"))
                        .with("coordinate_transformation_mode", std::string("align_corners"));
                  }},
                 {real({1, 1, 1, 3}, {1, 2, 3})});
  expect_results({"GridSample", {real({1, 1, 1, 2}, {1, 3}), real({1, 1, 1, 2}, {0, 0})}},
                 {real({1, 1, 1, 1}, {2})});
  EXPECT_THROW(run_operator({"Resize", {x, kNothing, real({4}, {1, 1, 1e6F, 1e6F})}}, false),
               core::InputError);
  const OperatorCase below_zero{
      "Resize", {x, kNothing, kNothing, whole({4}, {1, 1, 1, -2})}, [](NodeBuilder& n) {
        n.with("keep_aspect_ratio_policy", std::string("not_larger"));
      }};
  EXPECT_THAT(tests::input_error_of([&] { (void)run_operator(below_zero, false); }),
              testing::HasSubstr("expected scales and sizes from 0 to 2^30, found -2"));
}

TEST(OnnxRegion, SuppressionKeepsTheBest) {
  const auto boxes =
      real({1, 4, 4}, {0, 0, 10, 10, 1, 1, 11, 11, 20, 20, 30, 30, 0, 0, 10, 10});
  const auto scores = real({1, 1, 4}, {0.5F, 0.9F, 0.8F, 0.1F});
  expect_results({"NonMaxSuppression",
                  {boxes, scores, whole({1}, {10}), real({1}, {0.5F}), real({1}, {0.2F})}},
                 {whole({2, 3}, {0, 0, 1, 0, 0, 2})});
  expect_results({"NonMaxSuppression",
                  {boxes, scores, whole({1}, {1}), real({1}, {0.5F}), real({1}, {0.2F})}},
                 {whole({1, 3}, {0, 0, 1})});
}

TEST(OnnxRegion, AlignedRegionOfARampIsTheRamp) {
  Floats ramp;
  for (int y = 0; y < 8; ++y) {
    for (int x = 0; x < 8; ++x) ramp.push_back(static_cast<float>(x) + 0.5F);
  }
  expect_results(
      {"RoiAlign",
       {real({1, 1, 8, 8}, ramp), real({1, 4}, {1, 1, 5, 5}), whole({1}, {0})},
       [](NodeBuilder& n) {
         n.with("output_height", 1).with("output_width", 2).with("sampling_ratio", 2);
       }},
      {real({1, 1, 1, 2}, {2, 4})});
}

TEST(OnnxMatrix, QuantisedNumbers) {
  const auto as_uint8 = std::map<std::size_t, int>{{2, ::onnx::TensorProto::UINT8}};
  expect_results({"QuantizeLinear",
                  {real({3}, {-1, 0.26F, 100}), real({}, {0.5F}), whole({}, {3})},
                  {},
                  17,
                  1,
                  as_uint8},
                 {whole({3}, {1, 4, 203})});
  expect_results({"DequantizeLinear",
                  {whole({2}, {1, 4}), real({}, {0.5F}), whole({}, {3})},
                  {},
                  17,
                  1,
                  {{0, ::onnx::TensorProto::UINT8}, {2, ::onnx::TensorProto::UINT8}}},
                 {real({2}, {-1, 0.5F})});
}

}  // namespace
}  // namespace segsim::perception
