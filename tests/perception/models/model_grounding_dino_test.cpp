#include "perception/models/object_detector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/error.h"
#include "tests/perception/model_files.h"
#include "tests/perception/models/onnx_operator_case.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using core::Image;
using core::Rgb8;
using testing::HasSubstr;

/// Two queries; the logit of token t at query q is +4 where the token's id is q's, else -4.
/// The boxes are fixed; input names as in Hugging Face's export.
std::filesystem::path write_grounding_dino(const tests::TemporaryFolder& folder,
                                           const Ints& ids_of_queries) {
  GraphBuilder builder(17);
  builder.input("pixel_values", {1, 3, -1, -1});
  builder.input("input_ids", {1, -1}, kInt64Type);
  builder.input("token_type_ids", {1, -1}, kInt64Type);
  builder.input("attention_mask", {1, -1}, kInt64Type);
  builder.input("pixel_mask", {1, -1, -1}, kInt64Type);
  const auto queries = static_cast<std::int64_t>(ids_of_queries.size());
  builder.constant("wanted", int_tensor({1, queries, 1}, ids_of_queries));
  builder.ints("one", {1});
  builder.node("Unsqueeze", {"input_ids", "one"}, {"ids"});
  builder.node("Equal", {"ids", "wanted"}, {"same"});
  builder.node("Cast", {"same"}, {"same_real"}).with("to", kFloatType);
  builder.floats("eight", {}, {8});
  builder.floats("four", {}, {4});
  builder.node("Mul", {"same_real", "eight"}, {"scaled"});
  builder.node("Sub", {"scaled", "four"}, {"short_logits"});
  builder.node("Shape", {"input_ids"}, {"shape"});
  builder.ints("last", {1});
  builder.node("Gather", {"shape", "last"}, {"length"});
  builder.ints("all_tokens", {256});
  builder.node("Sub", {"all_tokens", "length"}, {"rest"});
  builder.ints("five_zeros", {0, 0, 0, 0, 0});
  builder.node("Concat", {"five_zeros", "rest"}, {"pads"}).with("axis", 0);
  builder.floats("low", {}, {-100});
  builder.node("Pad", {"short_logits", "pads", "low"}, {"logits"});
  Floats boxes;
  for (std::int64_t q = 0; q < queries; ++q) {
    const float x = 0.25F + 0.25F * static_cast<float>(q);
    boxes.insert(boxes.end(), {x, 0.5F, 0.2F, 0.5F});
  }
  builder.floats("pred_boxes_raw", {1, queries, 4}, boxes);
  builder.node("Identity", {"pred_boxes_raw"}, {"pred_boxes"});
  builder.output("logits");
  builder.output("pred_boxes");
  builder.save(folder / "gdino.onnx");
  write_text(folder / "vocab.txt", kVocabulary);
  write_text(folder / "gdino.yaml",
             "schema: segsim.model/1\ntask: grounding-dino\n"
             "files: {model: gdino.onnx, tokenizer: vocab.txt}\ninput_px: 32\n");
  return folder / "gdino.yaml";
}

TEST(GroundingDinoModel, BoxesTakeThePhraseOfTheirToken) {
  const tests::TemporaryFolder folder;
  // Query 0 answers to "table", query 1 to the dot, which is no phrase's, query 2 to "##s".
  const auto model = write_grounding_dino(folder, {7, 4, 8});
  ObjectDetectorOptions options;
  options.prompts = parse_prompt("Chairs. office table.");
  const auto detector = load_object_detector(model, options);
  EXPECT_THAT(detector->class_names(), testing::ElementsAre("chairs", "office table"));
  const auto found = detect(*detector, Image<Rgb8>(100, 40));
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].class_index, 1);
  EXPECT_NEAR(found[0].score, 1 / (1 + std::exp(-4.0F)), 1e-6F);
  EXPECT_NEAR(found[0].box.x0, 15, 1e-3F);
  EXPECT_NEAR(found[0].box.x1, 35, 1e-3F);
  EXPECT_NEAR(found[0].box.y0, 10, 1e-3F);
  EXPECT_NEAR(found[0].box.y1, 30, 1e-3F);
  EXPECT_EQ(found[1].class_index, 0);
}

TEST(GroundingDinoModel, NeedsAPromptAndItsTokenizer) {
  const tests::TemporaryFolder folder;
  const auto model = write_grounding_dino(folder, {5});
  EXPECT_THAT(tests::input_error_of([&] { (void)load_object_detector(model); }),
              HasSubstr("a text prompt"));
  write_text(folder / "vocab.txt", "chair\n");
  ObjectDetectorOptions options;
  options.prompts = {"chair"};
  EXPECT_THAT(tests::input_error_of([&] { (void)load_object_detector(model, options); }),
              HasSubstr("[CLS]"));
}

TEST(Prompt, IsSplitAtDots) {
  EXPECT_THAT(parse_prompt(" Chair. office  desk . "),
              testing::ElementsAre("chair", "office  desk"));
  EXPECT_THROW((void)parse_prompt(" . "), core::InputError);
  EXPECT_THROW((void)parse_prompt("a. A"), core::InputError);
}

}  // namespace
}  // namespace segsim::perception
