#include "perception/internal/centernet/network.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "perception/centernet/import.h"
#include "perception/data/coco_names.h"
#include "perception/data/image_file.h"
#include "perception/data/nms.h"
#include "perception/detector/detector.h"
#include "perception/internal/centernet/decode.h"
#include "perception/internal/centernet/loss.h"
#include "tests/temporary_folder.h"

namespace segsim::perception::centernet {
namespace {

double largest(const torch::Tensor& difference) {
  return difference.abs().max().item<double>();
}

TEST(CenterNet, HasThePublishedSizeAndAMapAtAQuarter) {
  const torch::NoGradGuard no_grad;
  Network network(80);
  std::int64_t count = 0;
  for (const auto& parameter : network->parameters()) count += parameter.numel();
  EXPECT_EQ(count, 2'014'924);
  EXPECT_TRUE(network->buffers().empty());
  network->initialize(1);
  const HeatMaps maps = network->forward(torch::rand({2, 3, 64, 96}));
  EXPECT_EQ(maps.classes.sizes(), (std::vector<std::int64_t>{2, 80, 16, 24}));
  EXPECT_EQ(maps.sides_px.sizes(), (std::vector<std::int64_t>{2, 4, 16, 24}));
  // Every class begins near a score of 0.1.
  EXPECT_LT(largest(maps.classes.sigmoid() - 0.1), 0.05);
  Network same(80), other(80);
  same->initialize(1);
  other->initialize(2);
  const auto stem = [](Network& n) { return n->named_parameters()["stem.weight"]; };
  EXPECT_TRUE(torch::equal(stem(network), stem(same)));
  EXPECT_FALSE(torch::equal(stem(network), stem(other)));
}

TEST(CenterNet, PreparedForInferenceItSaysTheSame) {
  const torch::NoGradGuard no_grad;
  Network network(7);
  network->initialize(3);
  torch::manual_seed(2);
  // Heads that say something.
  auto parameters = network->named_parameters();
  for (const char* name : {"class_head.last.weight", "box_head.last.weight"}) {
    parameters[name].copy_(torch::randn(parameters[name].sizes()) * 0.1);
  }
  for (const int side : {32, 96}) {
    const auto x = torch::rand({2, 3, side, 64});
    Network folded(7);
    import_tensors(*folded, export_tensors(*network), "copy");
    folded->prepare_for_inference();
    const HeatMaps plain = network->forward(x), quick = folded->forward(x);
    // Of a random network the values are large: rounding is relative to them.
    EXPECT_LT(largest(plain.classes - quick.classes), 1e-5 * largest(plain.classes));
    EXPECT_LT(largest(plain.sides_px - quick.sides_px), 1e-5 * largest(plain.sides_px));
    EXPECT_GT(largest(plain.classes - plain.classes.mean()), 0.1);
  }
}

TEST(CenterNet, MapsAreDoubledAsTensorFlowDoes) {
  const auto x = torch::tensor({0.0F, 4.0F, 8.0F, 2.0F}).view({1, 1, 2, 2});
  const auto wanted = torch::tensor({0.0F, 2.0F, 4.0F, 4.0F,  //
                                     4.0F, 3.5F, 3.0F, 3.0F,  //
                                     8.0F, 5.0F, 2.0F, 2.0F,  //
                                     8.0F, 5.0F, 2.0F, 2.0F})
                          .view({1, 1, 4, 4});
  EXPECT_TRUE(torch::equal(double_sides(x), wanted));
  const auto one = torch::full({1, 3, 1, 1}, 5.0F);
  EXPECT_TRUE(torch::equal(double_sides(one), torch::full({1, 3, 2, 2}, 5.0F)));
}

TEST(CenterNetPeaks, AreTheHighestOfTheirNeighbours) {
  torch::manual_seed(4);
  const HeatMaps maps{torch::randn({2, 3, 5, 7}), torch::rand({2, 4, 5, 7}) * 20};
  const auto scores = maps.classes.sigmoid();
  constexpr float kThreshold = 0.55F;
  std::vector<std::vector<core::Detection>> wanted(2);
  for (int image = 0; image < 2; ++image) {
    for (int y = 0; y < 5; ++y) {
      for (int x = 0; x < 7; ++x) {
        for (int c = 0; c < 3; ++c) {
          const auto around = scores[image][c]
                                  .slice(0, std::max(0, y - 1), y + 2)
                                  .slice(1, std::max(0, x - 1), x + 2);
          const float own = scores[image][c][y][x].item<float>();
          if (own < kThreshold || around.max().item<float>() > own) continue;
          const auto side = [&](int k) { return maps.sides_px[image][k][y][x].item<float>(); };
          const auto px = static_cast<float>(4 * x), py = static_cast<float>(4 * y);
          wanted[static_cast<std::size_t>(image)].push_back(
              {c, own, {px - side(0), py - side(1), px + side(2), py + side(3)}});
        }
      }
    }
  }
  ASSERT_GT(wanted[0].size(), 3U);
  for (const auto& found :
       {peaks_on_host(maps, kThreshold), peaks_on_device(maps, kThreshold)}) {
    ASSERT_EQ(found.size(), 2U);
    for (std::size_t image = 0; image < 2; ++image) {
      ASSERT_EQ(found[image].size(), wanted[image].size());
      for (std::size_t i = 0; i < wanted[image].size(); ++i) {
        const auto &a = found[image][i], &b = wanted[image][i];
        EXPECT_EQ(a.class_index, b.class_index);
        EXPECT_NEAR(a.score, b.score, 1e-6F);
        EXPECT_FLOAT_EQ(a.box.x0, b.box.x0);
        EXPECT_FLOAT_EQ(a.box.y0, b.box.y0);
        EXPECT_FLOAT_EQ(a.box.x1, b.box.x1);
        EXPECT_FLOAT_EQ(a.box.y1, b.box.y1);
      }
    }
  }
}

LabeledBox object(int class_index, const core::BoxPx& box) {
  LabeledBox label;
  label.class_index = class_index;
  label.box = box;
  return label;
}

/// 128 px, 12 classes, as the reference was computed.
struct Example {
  std::vector<std::vector<LabeledBox>> truth{
      {object(3, {60, 40, 120, 120}), object(0, {20, 30, 80, 100})}};
  HeatMaps maps{torch::full({1, 12, 32, 32}, -2.19F), torch::full({1, 4, 32, 32}, 24.0F)};
};

TEST(CenterNetLoss, AgreesWithTheReference) {
  const Example example;
  const Targets targets = make_targets(example.truth, 12, 32, 32);
  EXPECT_EQ((targets.weight > 0).sum().item<std::int64_t>(), 180);
  EXPECT_NEAR(targets.weight.sum().item<double>(), 16.878876, 1e-5);
  const HeatLossParts parts = heat_loss(example.maps, example.truth);
  EXPECT_NEAR(parts.classes.item<double>(), 8.425433, 2e-5);
  EXPECT_NEAR(5.0 * parts.box.item<double>(), 2.529101, 1e-5);
}

TEST(CenterNetLoss, DerivativesAreThoseOfDifferences) {
  torch::manual_seed(8);
  const std::vector<std::vector<LabeledBox>> truth{{object(1, {3, 5, 27, 22})}};
  HeatMaps maps{torch::randn({1, 2, 8, 8}), torch::rand({1, 4, 8, 8}) * 10 + 4};
  const auto value = [&] {
    const HeatLossParts parts = heat_loss(maps, truth);
    return parts.classes + parts.box;
  };
  maps.classes.requires_grad_(true);
  maps.sides_px.requires_grad_(true);
  value().backward();
  // One cell under the Gaussian; box weights there are above 0.
  for (auto* map : {&maps.classes, &maps.sides_px}) {
    const torch::NoGradGuard no_grad;
    auto cell = (*map)[0][1][3].slice(0, 3, 4);
    const double gradient = map->grad()[0][1][3][3].item<double>();
    constexpr double kStep = 0.02;
    cell.add_(kStep);
    const double above = value().item<double>();
    cell.sub_(2 * kStep);
    const double below = value().item<double>();
    cell.add_(kStep);
    EXPECT_NEAR(gradient, (above - below) / (2 * kStep), 2e-3 * std::abs(gradient) + 1e-4);
    EXPECT_GT(std::abs(gradient), 1e-3);
  }
}

TEST(CenterNetLoss, IgnoredBoxesHideTheirClassAndNothingElse) {
  const Example example;
  auto with = example.truth;
  with[0].push_back(object(5, {0, 0, 64, 64}));
  with[0].back().ignore = true;
  const Targets targets = make_targets(with, 12, 32, 32);
  EXPECT_EQ((targets.judged == 0).sum().item<std::int64_t>(), 16 * 16);
  EXPECT_EQ(
      (targets.judged[0][5].slice(0, 0, 16).slice(1, 0, 16) == 0).sum().item<std::int64_t>(),
      16 * 16);
  const Targets without = make_targets(example.truth, 12, 32, 32);
  EXPECT_TRUE(torch::equal(targets.heat, without.heat));
  EXPECT_TRUE(torch::equal(targets.weight, without.weight));
  EXPECT_LT(heat_loss(example.maps, with).classes.item<double>(),
            heat_loss(example.maps, example.truth).classes.item<double>());
}

TEST(CenterNetLoss, EmptyPicturesAndEmptyBoxesHaveFiniteDerivatives) {
  for (const bool empty : {true, false}) {
    const std::vector<std::vector<LabeledBox>> truth{
        empty ? std::vector<LabeledBox>{}
              : std::vector<LabeledBox>{object(0, {12, 12, 12.5F, 12.5F}),
                                        object(1, {0, 0, 32, 32})}};
    // Logits beyond all bounds, boxes without a side and turned inside out.
    for (const float side : {0.0F, -3.0F, -0.5F}) {
      HeatMaps maps{torch::full({1, 2, 8, 8}, 200.0F).requires_grad_(true),
                    torch::full({1, 4, 8, 8}, side).requires_grad_(true)};
      const HeatLossParts parts = heat_loss(maps, truth);
      (parts.classes + parts.box).backward();
      EXPECT_TRUE(std::isfinite((parts.classes + parts.box).item<double>()));
      EXPECT_TRUE(maps.classes.grad().isfinite().all().item<bool>());
      EXPECT_TRUE(maps.sides_px.grad().isfinite().all().item<bool>());
      EXPECT_GT(largest(maps.classes.grad()), 0.0);
    }
  }
}

/// The picture that the golden outputs are of, and the published weights; skips without them.
class CenterNetGolden : public testing::Test {
 protected:
  void SetUp() override {
    const char* data = std::getenv("SEGSIM_DATA");
    if (data == nullptr) GTEST_SKIP() << "SEGSIM_DATA does not name the folder with centernet";
    const auto folder = std::filesystem::path(data) / "centernet";
    if (!std::filesystem::exists(folder / "centernet.json")) {
      GTEST_SKIP() << folder << " has no centernet.json";
    }
    picture_ = read_image(folder / "fixture_256x192.png");
    weights_ = read_published_weights(read_tensor_file(folder / "centernet.json"),
                                      folder / "centernet.json");
  }

  /// Between black bars, with every pixel `times` x `times` large; 0 ... 255.
  [[nodiscard]] torch::Tensor square(int times) const {
    auto levels = torch::zeros({3, 256, 256});
    auto level = levels.accessor<float, 3>();
    for (int y = 0; y < 192; ++y) {
      for (int x = 0; x < 256; ++x) {
        const core::Rgb8 pixel = picture_(x, y);
        level[0][y + 32][x] = pixel.r;
        level[1][y + 32][x] = pixel.g;
        level[2][y + 32][x] = pixel.b;
      }
    }
    return levels.repeat_interleave(times, 1).repeat_interleave(times, 2).unsqueeze(0);
  }

  core::Image<core::Rgb8> picture_;
  DetectorWeights weights_;
};

struct Golden {
  int times;
  double input_sum, heat_sum, sides_sum_px;
  std::vector<std::pair<const char*, core::Detection>> best;
};

TEST_F(CenterNetGolden, BoxesAndScoresAreThoseOfTheOriginal) {
  const torch::NoGradGuard no_grad;
  const Golden cases[] = {
      {1,
       19213716,
       531.167,
       703215,
       {{"tv", {0, 0.535667F, {87.205F, 102.838F, 143.122F, 146.598F}}},
        {"vase", {0, 0.429677F, {203.308F, 134.580F, 222.792F, 151.960F}}},
        {"potted plant", {0, 0.315856F, {198.108F, 99.041F, 230.206F, 143.532F}}},
        {"suitcase", {0, 0.262834F, {26.538F, 114.928F, 86.150F, 164.120F}}},
        {"vase", {0, 0.255847F, {199.014F, 106.015F, 228.223F, 151.431F}}}}},
      {2,
       76854864,
       1262.16,
       5.1199e6,
       {{"tv", {0, 0.792237F, {178.175F, 213.640F, 280.772F, 282.163F}}},
        {"chair", {0, 0.691086F, {62.387F, 233.651F, 168.924F, 321.270F}}}}}};
  for (const Golden& golden : cases) {
    const auto levels = square(golden.times);
    EXPECT_EQ(levels.sum(torch::kFloat64).item<double>(), golden.input_sum);
    for (const bool folded : {false, true}) {
      Network network(80);
      import_tensors(*network, weights_.tensors, "published");
      if (folded) network->prepare_for_inference();
      const HeatMaps maps = network->forward(levels / 255.0);
      EXPECT_NEAR(maps.classes.sigmoid().sum(torch::kFloat64).item<double>(), golden.heat_sum,
                  1e-5 * golden.heat_sum);
      EXPECT_NEAR(maps.sides_px.sum(torch::kFloat64).item<double>(), golden.sides_sum_px,
                  1e-5 * golden.sides_sum_px);
      const auto found = suppress_overlaps(peaks_on_host(maps, 0.2F)[0], 1.0F, 100);
      ASSERT_GE(found.size(), golden.best.size());
      for (std::size_t i = 0; i < golden.best.size(); ++i) {
        const auto& [name, wanted] = golden.best[i];
        EXPECT_EQ(coco_names()[static_cast<std::size_t>(found[i].class_index)], name);
        EXPECT_NEAR(found[i].score, wanted.score, 1e-5F);
        EXPECT_NEAR(found[i].box.x0, wanted.box.x0, 1e-3F);
        EXPECT_NEAR(found[i].box.y0, wanted.box.y0, 1e-3F);
        EXPECT_NEAR(found[i].box.x1, wanted.box.x1, 1e-3F);
        EXPECT_NEAR(found[i].box.y1, wanted.box.y1, 1e-3F);
      }
    }
  }
}

// Through the weights file and the detector's interface, with its grey bars and boxes in
// pixels of the picture.
TEST_F(CenterNetGolden, TheDetectorFindsTheTelevision) {
  const tests::TemporaryFolder folder;
  weights_.input_px = 256;
  write_weights(folder / "c.weights", weights_);
  const auto detector = load_detector(folder / "c.weights");
  core::Observation observation;
  observation.rgb = &picture_;
  const auto found = detector->detect(observation);
  EXPECT_TRUE(std::any_of(found.begin(), found.end(), [&](const core::Detection& one) {
    return detector->class_names()[static_cast<std::size_t>(one.class_index)] == "tv" &&
           one.score > 0.3F && core::iou(one.box, {87.2F, 70.8F, 143.1F, 114.6F}) > 0.8F;
  }));
}

}  // namespace
}  // namespace segsim::perception::centernet
