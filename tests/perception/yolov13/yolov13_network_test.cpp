#include "perception/internal/yolov13/network.h"

#include <gtest/gtest.h>

#include "perception/yolov13/import.h"
#include "perception/yolov13/model.h"
#include "tests/temporary_folder.h"

namespace segsim::perception::yolov13 {
namespace {

/// Channels before the scale (several where maps are concatenated) and stride of a layer.
struct Expected {
  std::size_t layer;
  std::vector<int> channels;
  int stride;
};

TEST(Yolov13Network, MapsOfAllLayersHaveThePublishedSizes) {
  const std::vector<Expected> all = {
      {0, {64}, 2},     {1, {128}, 4},   {2, {256}, 4},       {3, {256}, 8},
      {4, {512}, 8},    {5, {512}, 16},  {6, {512}, 16},      {7, {1024}, 32},
      {8, {1024}, 32},  {9, {512}, 16},  {10, {512}, 8},      {11, {1024}, 32},
      {12, {512}, 16},  {13, {512}, 8},  {14, {1024}, 32},    {16, {1024, 512}, 16},
      {17, {512}, 16},  {18, {512}, 16}, {20, {512, 512}, 8}, {21, {256}, 8},
      {22, {256}, 8},   {23, {256}, 8},  {24, {256}, 16},     {25, {256, 512}, 16},
      {26, {512}, 16},  {27, {512}, 16}, {28, {512}, 32},     {29, {512, 1024}, 32},
      {30, {1024}, 32}, {31, {1024}, 32}};
  for (const Scale scale : kAllScales) {
    Network network(scale, 3);
    network->eval();
    network->keep_maps(true);
    const torch::InferenceMode inference;
    const RawOutput raw = network->forward(torch::zeros({2, 3, 64, 96}));
    const int64_t anchors = 12 * 8 + 6 * 4 + 3 * 2;
    EXPECT_EQ(raw.box.sizes().vec(), (std::vector<int64_t>{2, anchors, 64}));
    EXPECT_EQ(raw.classes.sizes().vec(), (std::vector<int64_t>{2, anchors, 3}));
    for (const Expected& expected : all) {
      int64_t channels = 0;
      for (const int nominal : expected.channels)
        channels += table_of(scale).channels(nominal);
      EXPECT_EQ(
          network->maps()[expected.layer].sizes().vec(),
          (std::vector<int64_t>{2, channels, 64 / expected.stride, 96 / expected.stride}))
          << table_of(scale).letter << " layer " << expected.layer;
    }
  }
}

TEST(Yolov13Network, EveryParameterIsTrained) {
  for (const Scale scale : {Scale::kN, Scale::kL}) {
    Network network(scale, 3);
    network->initialize(1);
    network->train();
    {
      // Closed gates hide the hyperedges from the loss.
      const torch::NoGradGuard no_grad;
      for (const auto& item : network->named_parameters()) {
        if (item.key().find(".gate") != std::string::npos) item.value().fill_(0.5);
      }
    }
    torch::manual_seed(1);
    const RawOutput raw = network->forward(torch::rand({2, 3, 64, 64}));
    (raw.box.square().sum() + raw.classes.square().sum()).backward();
    for (const auto& item : network->named_parameters()) {
      const bool constant = item.key() == "model.32.dfl.conv.weight";
      // Equal for all tokens, so the softmax over tokens removes it.
      const bool without_effect = item.key().find("pre_head_proj.bias") != std::string::npos;
      EXPECT_EQ(item.value().requires_grad(), !constant) << item.key();
      if (constant || without_effect) continue;
      ASSERT_TRUE(item.value().grad().defined()) << item.key();
      EXPECT_GT(item.value().grad().abs().sum().item<double>(), 0.0) << item.key();
    }
  }
}

/// libtorch 1.13's own GELU fails this: hypergraph.cpp.
TEST(Yolov13Network, DerivativesOfTheHypergraphInFloatEqualThoseInDouble) {
  torch::manual_seed(3);
  C3AH block(32, 4);
  block.eval();  // No dropout.
  for (const auto& item : block.named_parameters()) {
    if (item.value().dim() < 2) continue;
    fill_uniform(item.value(), 0.5, 1, item.key());
  }
  const auto x = torch::randn({2, 32, 4, 4}), weight = torch::randn({2, 32, 4, 4});
  std::vector<torch::Tensor> in_float, in_double;
  for (auto* derivatives : {&in_float, &in_double}) {
    const auto type = derivatives == &in_float ? torch::kFloat32 : torch::kFloat64;
    block.to(type);
    block.zero_grad();
    (block.forward(x.to(type)) * weight.to(type)).sum().backward();
    for (const auto& parameter : block.parameters()) {
      derivatives->push_back(parameter.grad().to(torch::kFloat64).clone());
    }
  }
  const auto names = block.named_parameters().keys();
  for (std::size_t i = 0; i < names.size(); ++i) {
    const double size = in_double[i].norm().item<double>();
    const double difference = (in_float[i] - in_double[i]).norm().item<double>();
    EXPECT_LT(difference, 1e-5 * size + 1e-5) << names[i];
  }
}

TEST(Yolov13Network, TorchArchivesAreImported) {
  const tests::TemporaryFolder folder;
  Network network(Scale::kN, 2);
  network->initialize(8);
  torch::save(network, (folder / "archive.pt").string());
  const DetectorWeights made =
      import_weights({.source = folder / "archive.pt"}, folder / "n.weights");
  const auto wanted = export_tensors(*network);
  ASSERT_EQ(made.tensors.size(), wanted.size());
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    EXPECT_EQ(made.tensors[i].name, wanted[i].name);
    EXPECT_EQ(made.tensors[i].values, wanted[i].values);
  }
}

TEST(Yolov13Network, CountsOperationsOfALayer) {
  Conv conv(8, 16, 3, 2, 4);
  const MacCounter counter;
  (void)conv.forward(torch::zeros({1, 8, 10, 10}));
  EXPECT_EQ(counter.macs(), 5 * 5 * 16 * (8 / 4) * 9);
}

}  // namespace
}  // namespace segsim::perception::yolov13
