#include "perception/yolov13/model.h"

#include <gmock/gmock.h>

#include <cmath>

#include "core/check.h"
#include "core/random.h"
#include "perception/detector/detector.h"
#include "tests/perception/yolov13/yolov13_twin.h"
#include "tests/temporary_folder.h"

namespace segsim::perception::yolov13 {
namespace {

bool has_end(const std::string& name, const std::string& end) {
  return name.size() >= end.size() &&
         name.compare(name.size() - end.size(), end.size(), end) == 0;
}

/// Weights under which every layer, every gate and every statistic matters.
std::vector<NamedTensor> lively(std::vector<NamedTensor> tensors, std::uint64_t seed,
                                bool deep = false) {
  for (NamedTensor& tensor : tensors) {
    if (has_end(tensor.name, "dfl.conv.weight")) continue;
    core::RandomStream random(seed, "lively/" + tensor.name);
    double fan_in = 1.0;
    for (std::size_t i = 1; i < tensor.shape.size(); ++i)
      fan_in *= static_cast<double>(tensor.shape[i]);
    const bool scale = has_end(tensor.name, "bn.weight") || has_end(tensor.name, ".gate") ||
                       has_end(tensor.name, "running_var");
    // Attention and hyperedges that single out some of the few tokens. In the many blocks of
    // the deep scales values grow until rounding decides which token is picked: calmer there.
    const bool hyperedge = tensor.name.find(".hgnn.") != std::string::npos;
    const bool attention = tensor.name.find(".qk.") != std::string::npos;
    const double gain = hyperedge ? 6.0 : !attention ? 1.0 : deep ? 1.0 : 6.0;
    const double bound =
        tensor.shape.size() >= 2 ? gain * std::sqrt((deep ? 2.0 : 2.5) / fan_in) : 0.3;
    for (float& value : tensor.values) {
      value =
          static_cast<float>(scale ? random.uniform(0.6, 1.4) : random.uniform(-bound, bound));
    }
  }
  return tensors;
}

std::vector<float> random_pixels(int batch, int height, int width) {
  std::vector<float> pixels(static_cast<std::size_t>(batch * 3 * height * width));
  core::RandomStream random(3, "pixels");
  for (float& value : pixels) value = static_cast<float>(random.uniform());
  return pixels;
}

class EveryScale : public testing::TestWithParam<Scale> {};

TEST_P(EveryScale, HasThePublishedCounts) {
  const Model model(GetParam(), 80);
  const ScaleTable& table = table_of(GetParam());
  EXPECT_EQ(model.parameter_count(), table.parameters);
  EXPECT_EQ(model.state_entries(), table.state_entries);
  // The published figures are a count at 32 px times 400, batch norms included.
  EXPECT_NEAR(model.gflops(32) * 400.0 / table.published_gflops, 0.99, 0.01);
}

/// Largest difference of two lists, relative to the largest value.
double difference(const std::vector<float>& found, const std::vector<double>& wanted) {
  EXPECT_EQ(found.size(), wanted.size());
  double worst = 0.0, top = 0.0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    worst = std::max(worst, std::abs(found[i] - wanted[i]));
    top = std::max(top, std::abs(wanted[i]));
  }
  EXPECT_GT(top, 0.1);
  EXPECT_LT(top, 1e4);
  return worst / top;
}

TEST_P(EveryScale, ComputesWhatTheScalarTwinComputes) {
  constexpr int kHeight = 64, kWidth = 96, kClasses = 6;
  Model model(GetParam(), kClasses);
  const auto tensors = lively(model.tensors(), 5, table_of(GetParam()).deep_inner);
  model.import(tensors, "lively");
  const auto pixels = random_pixels(1, kHeight, kWidth);
  Map image(3, kHeight, kWidth);
  std::copy(pixels.begin(), pixels.end(), image.values.begin());

  std::vector<double> box, classes;
  for (const Twin::Level& level : Twin(GetParam(), tensors).run(image)) {
    for (int t = 0; t < level.box.tokens(); ++t) {
      for (int c = 0; c < level.box.channels; ++c) box.push_back(level.box.token(c, t));
      for (int c = 0; c < kClasses; ++c) classes.push_back(level.classes.token(c, t));
    }
  }
  const ImageBatch images{1, kHeight, kWidth, pixels};
  const HeadOutput plain = model.forward(images), folded = model.forward_folded(images);
  EXPECT_EQ(plain.anchors(), 12 * 8 + 6 * 4 + 3 * 2);
  EXPECT_LT(difference(plain.box, box), 1e-5);
  EXPECT_LT(difference(plain.classes, classes), 1e-5);
  EXPECT_LT(difference(folded.box, box), 1e-5);
  EXPECT_LT(difference(folded.classes, classes), 1e-5);
}

// Guards the comparison above: under these weights no part is silent.
TEST(Yolov13, EveryTensorMatters) {
  constexpr int kSide = 64;
  Model model(Scale::kN, 6);
  const auto tensors = lively(model.tensors(), 5);
  model.import(tensors, "lively");
  const auto pixels = random_pixels(1, kSide, kSide);
  const ImageBatch images{1, kSide, kSide, pixels};
  const HeadOutput before = model.forward(images);
  for (std::size_t i = 0; i < tensors.size(); ++i) {
    const std::string& name = tensors[i].name;
    if (has_end(name, "dfl.conv.weight") || name.find(".bn.") != std::string::npos) continue;
    // Equal for all tokens, so the softmax over tokens removes it.
    if (has_end(name, "pre_head_proj.bias")) continue;
    auto changed = tensors;
    for (float& value : changed[i].values) value *= 1.5F;
    model.import(changed, "changed");
    const HeadOutput after = model.forward(images);
    double worst = 0.0;
    for (std::size_t k = 0; k < before.box.size(); ++k) {
      worst = std::max(worst, std::abs(double{after.box[k]} - before.box[k]));
    }
    for (std::size_t k = 0; k < before.classes.size(); ++k) {
      worst = std::max(worst, std::abs(double{after.classes[k]} - before.classes[k]));
    }
    EXPECT_GT(worst, 5e-5) << name;
  }
}

INSTANTIATE_TEST_SUITE_P(Yolov13, EveryScale, testing::ValuesIn(kAllScales),
                         [](const auto& scale) {
                           return std::string(1, table_of(scale.param).letter);
                         });

TEST(Yolov13, CountsOf640PixelsAreThoseOfTheBrief) {
  EXPECT_NEAR(Model(Scale::kN, 80).gflops(640), 6.26, 0.01);
}

TEST(Yolov13, BatchesDoNotMix) {
  Model model(Scale::kN, 3);
  model.import(lively(model.tensors(), 1), "lively");
  const auto pixels = random_pixels(2, 64, 64);
  const HeadOutput both = model.forward({2, 64, 64, pixels});
  const std::size_t half = pixels.size() / 2;
  const HeadOutput second = model.forward({1, 64, 64, std::span(pixels).subspan(half)});
  ASSERT_EQ(both.classes.size(), 2 * second.classes.size());
  for (std::size_t i = 0; i < second.classes.size(); ++i) {
    EXPECT_NEAR(both.classes[second.classes.size() + i], second.classes[i], 1e-4);
  }
}

TEST(Yolov13, StartIsTheSameForEqualSeedsAndAsPublished) {
  const Model a(Scale::kN, 6, 1), again(Scale::kN, 6, 1), b(Scale::kN, 6, 2);
  const auto ta = a.tensors(), tb = b.tensors(), tagain = again.tensors();
  int differ = 0;
  for (std::size_t i = 0; i < ta.size(); ++i) {
    EXPECT_EQ(ta[i].values, tagain[i].values) << ta[i].name;
    differ += ta[i].values != tb[i].values ? 1 : 0;
    if (has_end(ta[i].name, ".gate")) {
      EXPECT_EQ(ta[i].values, std::vector<float>{0.0F});
    }
    if (ta[i].name == "model.32.cv2.1.2.bias") {
      EXPECT_EQ(ta[i].values[63], 1.0F);
    }
    if (ta[i].name == "model.32.cv3.1.2.bias") {
      EXPECT_NEAR(ta[i].values[5], std::log(5.0 / 6.0 / (40.0 * 40.0)), 1e-5);
    }
  }
  EXPECT_GT(differ, 100);
}

TEST(Yolov13, ClassBranchWidthFollowsTheClasses) {
  const auto shape_of = [](int classes) {
    for (const NamedTensor& tensor : Model(Scale::kN, classes).tensors()) {
      if (tensor.name == "model.32.cv3.0.2.weight") return tensor.shape;
    }
    return std::vector<std::int64_t>{};
  };
  EXPECT_EQ(shape_of(80), (std::vector<std::int64_t>{80, 80, 1, 1}));
  EXPECT_EQ(shape_of(6), (std::vector<std::int64_t>{6, 64, 1, 1}));
  EXPECT_EQ(shape_of(200), (std::vector<std::int64_t>{200, 100, 1, 1}));
}

TEST(Yolov13, RefusesTensorsOfAnotherScaleAndOddImages) {
  Model model(Scale::kN, 2);
  try {
    model.import(Model(Scale::kS, 2).tensors(), "s.weights");
    FAIL() << "accepted";
  } catch (const std::exception& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("s.weights: the tensors do not fit"));
  }
  const auto pixels = random_pixels(1, 64, 40);
  EXPECT_THROW((void)model.forward({1, 64, 40, pixels}), core::ContractViolation);
}

TEST(Yolov13Detector, LoadsWeightsAndFindsWhatTheModelSays) {
  const tests::TemporaryFolder folder;
  Model model(Scale::kN, 2);
  DetectorWeights weights;
  weights.architecture = architecture_of(Scale::kN);
  weights.width = table_of(Scale::kN).width;
  weights.input_px = 64;
  weights.class_names = {"chair", "table"};
  weights.tensors = lively(model.tensors(), 9);
  write_weights(folder / "n.weights", weights);
  model.import(weights.tensors, "lively");

  core::Image<core::Rgb8> image(64, 64);
  core::RandomStream random(4, "image");
  for (core::Rgb8& pixel : image.pixels()) {
    pixel = {static_cast<std::uint8_t>(random.index(256)),
             static_cast<std::uint8_t>(random.index(256)),
             static_cast<std::uint8_t>(random.index(256))};
  }
  std::vector<float> pixels;
  for (const auto channel : {&core::Rgb8::r, &core::Rgb8::g, &core::Rgb8::b}) {
    for (const core::Rgb8& pixel : image.pixels())
      pixels.push_back(static_cast<float>(pixel.*channel) / 255.0F);
  }
  const auto output = model.forward({1, 64, 64, pixels});
  const auto predictions = decode(output);
  const std::size_t anchors = static_cast<std::size_t>(output.anchors());
  std::size_t best = 0, best_class = 0;
  for (std::size_t c = 0; c < 2; ++c) {
    for (std::size_t a = 0; a < anchors; ++a) {
      if (predictions[(4 + c) * anchors + a] <= predictions[(4 + best_class) * anchors + best])
        continue;
      best = a;
      best_class = c;
    }
  }

  const auto detector = load_detector(folder / "n.weights", {.score_threshold = 0.0F});
  core::Observation observation;
  observation.rgb = &image;
  const auto found = detector->detect(observation);
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found[0].class_index, static_cast<int>(best_class));
  EXPECT_NEAR(found[0].score, predictions[(4 + best_class) * anchors + best], 1e-4);
  const auto row = [&](std::size_t i) { return predictions[i * anchors + best]; };
  EXPECT_NEAR(found[0].box.x0, std::clamp(row(0) - row(2) / 2, 0.0F, 64.0F), 1e-2);
  EXPECT_NEAR(found[0].box.y1, std::clamp(row(1) + row(3) / 2, 0.0F, 64.0F), 1e-2);
}

}  // namespace
}  // namespace segsim::perception::yolov13
