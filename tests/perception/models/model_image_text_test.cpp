#include "perception/models/image_text_scorer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/error.h"
#include "tests/perception/clip_model.h"
#include "tests/perception/model_files.h"
#include "tests/perception/models/onnx_operator_case.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using core::Image;
using core::Rgb8;

TEST(ClipModel, CosineOfPictureAndText) {
  const tests::TemporaryFolder folder;
  const auto scorer = load_image_text_scorer(write_clip(folder / "", "clip"));
  const auto scores = scorer->scores(Image<Rgb8>(40, 30, {255, 0, 0}), {"chair", "table"});
  ASSERT_EQ(scores.size(), 2U);
  // (1 - m) / s for red, -m / s for the others.
  const double v[3] = {(1 - 0.48145466) / 0.26862954, -0.4578275 / 0.26130258,
                       -0.40821073 / 0.27577711};
  const double length = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) * std::sqrt(1.02);
  EXPECT_NEAR(scores[0], (v[0] + 0.1 * v[1] + 0.1 * v[2]) / length, 1e-5);
  EXPECT_NEAR(scores[1], (0.1 * v[0] + 0.1 * v[1] + v[2]) / length, 1e-5);
}

TEST(ClipModel, SiglipHasItsOwnColoursAndScale) {
  const tests::TemporaryFolder folder;
  const auto scorer = load_image_text_scorer(write_clip(folder / "", "siglip"));
  const auto scores = scorer->scores(Image<Rgb8>(8, 8, {255, 0, 0}), {"chair"});
  const double cosine = (1 - 0.1 - 0.1) / std::sqrt(3.0) / std::sqrt(1.02);
  EXPECT_NEAR(scores.at(0), 1 / (1 + std::exp(-(2 * cosine - 1))), 1e-5);
}

TEST(ClipModel, MatcherGivesTheProbabilityOfAMatch) {
  const tests::TemporaryFolder folder;
  GraphBuilder builder(17);
  builder.input("pixel_values", {1, 3, 4, 4});
  builder.input("input_ids", {1, -1}, kInt64Type);
  builder.node("ReduceMax", {"input_ids"}, {"top"}).with("keepdims", 0);
  builder.node("Cast", {"top"}, {"top_real"}).with("to", kFloatType);
  builder.floats("unit", {1, 2}, {0, 0.5F});
  builder.node("Mul", {"unit", "top_real"}, {"itm_logits"});
  builder.output("itm_logits");
  builder.save(folder / "itm.onnx");
  write_text(folder / "vocab.txt", kVocabulary);
  write_text(
      folder / "itm.yaml",
      "schema: segsim.model/1\ntask: itm\nfiles: {model: itm.onnx, tokenizer: vocab.txt}\n");
  const auto scores = load_image_text_scorer(folder / "itm.yaml")
                          ->scores(Image<Rgb8>(9, 5), {"chair", "office table"});
  EXPECT_NEAR(scores.at(0), 1 / (1 + std::exp(-2.5)), 1e-5);  // Highest id 5, then 7.
  EXPECT_NEAR(scores.at(1), 1 / (1 + std::exp(-3.5)), 1e-5);
}

}  // namespace
}  // namespace segsim::perception
