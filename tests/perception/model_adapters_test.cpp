// Adapters around small models with the signatures of the real ones. Each graph computes its
// answer from the picture or the prompt, so pre- and post-processing are seen through it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/error.h"
#include "core/file_io.h"
#include "onnx_operator_case.h"
#include "perception/models/image_text_scorer.h"
#include "perception/models/object_detector.h"
#include "perception/models/prompt_segmenter.h"

namespace segsim::perception {
namespace {

using core::Image;
using core::Rgb8;
using testing::HasSubstr;

std::vector<core::Detection> detect(core::Detector& detector, const Image<Rgb8>& image) {
  core::Observation observation;
  observation.rgb = &image;
  return detector.detect(observation);
}

void write_text(const std::filesystem::path& file, const std::string& text) {
  core::write_file_atomically(file, [&](std::ostream& out) { out << text; });
}

template <class Function>
std::string message_of(const Function& function) {
  try {
    function();
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "";
}

/// 4 x 4 cells of 16 px; a cell's score of class 0 is its mean red, of class 1 its mean blue;
/// its box is the cell, in the layout [1, 4 + classes, cells] of YOLO v8 to v13.
void add_cell_head(GraphBuilder& builder, const std::string& predictions) {
  builder.input("images", {1, 3, 64, 64});
  builder.node("AveragePool", {"images"}, {"means"})
      .with("kernel_shape", Ints{16, 16})
      .with("strides", Ints{16, 16});
  builder.ints("red_blue", {0, 2});
  builder.node("Gather", {"means", "red_blue"}, {"two"}).with("axis", 1);
  builder.ints("flat", {1, 2, 16});
  builder.node("Reshape", {"two", "flat"}, {"scores"});
  Floats cells(64);
  for (std::size_t i = 0; i < 16; ++i) {
    cells[i] = static_cast<float>(i % 4) * 16 + 8;
    cells[16 + i] = static_cast<float>(i / 4) * 16 + 8;
    cells[32 + i] = cells[48 + i] = 16;
  }
  builder.floats("cells", {1, 4, 16}, cells);
  builder.node("Concat", {"cells", "scores"}, {predictions}).with("axis", 1);
}

std::filesystem::path write_yolo(const TestFolder& folder) {
  GraphBuilder builder(12);
  add_cell_head(builder, "output0");
  builder.output("output0");
  builder.metadata("names", "{0: 'chair', 1: \"cat's bed\"}");
  builder.save(folder / "yolo.onnx");
  return folder / "yolo.onnx";
}

/// 128 x 96: letterboxed to 64 x 64 with scale 0.5 and 8 px above and below.
Image<Rgb8> wide_picture() {
  Image<Rgb8> image(128, 96);
  for (int y = 48; y < 80;
       ++y) {  // Rows 32 to 48 of the square, columns 16 to 32: cell (1, 2).
    for (int x = 32; x < 64; ++x) image(x, y) = {255, 0, 0};
  }
  for (int y = 16; y < 48; ++y) {
    for (int x = 96; x < 128; ++x) image(x, y) = {0, 0, 204};  // Cell (3, 1).
  }
  return image;
}

void expect_wide_picture(const std::vector<core::Detection>& found) {
  ASSERT_EQ(found.size(), 2U);  // The grey bars (0.447) are below the threshold.
  EXPECT_EQ(found[0].class_index, 0);
  EXPECT_NEAR(found[0].score, 1.0F, 1e-5F);
  EXPECT_NEAR(found[0].box.x0, 32, 1e-3F);
  EXPECT_NEAR(found[0].box.y0, 48, 1e-3F);
  EXPECT_NEAR(found[0].box.x1, 64, 1e-3F);
  EXPECT_NEAR(found[0].box.y1, 80, 1e-3F);
  EXPECT_EQ(found[1].class_index, 1);
  EXPECT_NEAR(found[1].score, 0.8F, 1e-5F);
  EXPECT_NEAR(found[1].box.x1, 128, 1e-3F);
}

ObjectDetectorOptions above_half() {
  ObjectDetectorOptions options;
  options.score_threshold = 0.5F;
  return options;
}

TEST(YoloModel, BoxesReturnToThePicture) {
  const TestFolder folder;
  const auto detector = load_object_detector(write_yolo(folder), above_half());
  EXPECT_THAT(detector->class_names(), testing::ElementsAre("chair", "cat's bed"));
  expect_wide_picture(detect(*detector, wide_picture()));
}

TEST(YoloModel, SuppressionInsideTheGraph) {
  // The same head, transposed, NonMaxSuppression and gathering: [n, 7], as exporters of v7 do.
  const TestFolder folder;
  GraphBuilder builder(12);
  add_cell_head(builder, "all");
  builder.ints("two_parts", {4, 2});
  builder.node("Split", {"all"}, {"centres", "scores_of"})
      .with("axis", 1)
      .with("split", Ints{4, 2});
  builder.node("Transpose", {"centres"}, {"rows"}).with("perm", Ints{0, 2, 1});
  builder.ints("most", {100});
  builder.floats("iou", {1}, {0.5F});
  builder.floats("score", {1}, {0.5F});
  builder.node("NonMaxSuppression", {"rows", "scores_of", "most", "iou", "score"}, {"chosen"})
      .with("center_point_box", 1);
  builder.ints("last", {2});
  builder.ints("middle", {1});
  builder.node("Gather", {"chosen", "last"}, {"which"}).with("axis", 1);
  builder.node("Gather", {"chosen", "middle"}, {"label"}).with("axis", 1);
  builder.node("Squeeze", {"which"}, {"which_flat"}).with("axes", Ints{1});
  builder.node("Squeeze", {"rows"}, {"rows_flat"}).with("axes", Ints{0});
  builder.node("Gather", {"rows_flat", "which_flat"}, {"picked"});
  builder.floats("corners", {4, 4},
                 {1, 0, 1, 0, 0, 1, 0, 1, -0.5F, 0, 0.5F, 0, 0, -0.5F, 0, 0.5F});
  builder.node("MatMul", {"picked", "corners"}, {"boxes"});
  builder.node("Squeeze", {"scores_of"}, {"scores_flat"}).with("axes", Ints{0});
  builder.node("Concat", {"label", "which"}, {"places"}).with("axis", 1);
  builder.node("GatherND", {"scores_flat", "places"}, {"best"});
  builder.node("Unsqueeze", {"best"}, {"best_column"}).with("axes", Ints{1});
  builder.node("Cast", {"label"}, {"label_real"}).with("to", kFloatType);
  builder.node("Mul", {"label_real", "none"}, {"image"});
  builder.floats("none", {1}, {0});
  builder.node("Concat", {"image", "boxes", "label_real", "best_column"}, {"output"})
      .with("axis", 1);
  builder.output("output");
  builder.metadata("names", "{0: 'chair', 1: 'bed'}");
  builder.save(folder / "yolo.onnx");
  expect_wide_picture(
      detect(*load_object_detector(folder / "yolo.onnx", above_half()), wide_picture()));
}

TEST(YoloModel, ListedBoxesOfModelsThatNeedNoSuppression) {
  const TestFolder folder;
  GraphBuilder builder(17);
  builder.input("images", {1, 3, 64, 64});
  builder.node("ReduceMax", {"images"}, {"top"}).with("keepdims", 0);
  builder.floats("rows", {1, 3, 6},
                 {0, 8, 32, 56, 0.6F, 1, 10, 10, 20, 20, 0.9F, 0, 0, 0, 0, 0, 0, 0});
  builder.node("Mul", {"rows", "top"}, {"output0"});  // A white pixel leaves them as they are.
  builder.output("output0");
  builder.metadata("imgsz", "[64, 64]");
  GraphBuilder two = builder;
  builder.metadata("names", "{0: 'chair', 1: 'bed', 2: 'tv'}");
  builder.save(folder / "v10.onnx");
  const auto found = detect(*load_object_detector(folder / "v10.onnx"),
                            Image<Rgb8>(128, 96, {255, 255, 255}));
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].class_index, 0);
  EXPECT_EQ(found[1].class_index, 1);
  EXPECT_NEAR(found[1].box.y0, 0, 1e-3F);
  EXPECT_NEAR(found[1].box.x1, 64, 1e-3F);
  EXPECT_NEAR(found[1].box.y1, 96, 1e-3F);

  two.metadata("names", "{0: 'chair', 1: 'bed'}");  // Box and two scores are six numbers, too.
  two.save(folder / "two.onnx");
  const auto detector = load_object_detector(folder / "two.onnx");
  EXPECT_THAT(message_of([&] { (void)detect(*detector, wide_picture()); }),
              HasSubstr("expected an output [1, 6, n] (exported without nms), since for 2 "
                        "classes six columns"));
}

TEST(YoloModel, PromptsChooseAndOrderItsClasses) {
  const TestFolder folder;
  ObjectDetectorOptions options = above_half();
  options.prompts = {"cat's bed"};
  const auto detector = load_object_detector(write_yolo(folder), options);
  const auto found = detect(*detector, wide_picture());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].class_index, 0);
  options.prompts = {"sofa"};
  EXPECT_THAT(message_of([&] { (void)load_object_detector(folder / "yolo.onnx", options); }),
              HasSubstr("'sofa', which it does not have"));
}

TEST(YoloModel, SizesOfPicturesFromOnePixelOn) {
  const TestFolder folder;
  const auto detector = load_object_detector(write_yolo(folder), above_half());
  EXPECT_EQ(detect(*detector, Image<Rgb8>(1, 1, {255, 0, 0})).size(), 16U);
  EXPECT_NO_THROW((void)detect(*detector, Image<Rgb8>(3000, 2)));
}

TEST(YoloModel, OtherOutputsAndNamesAreRefused) {
  const TestFolder folder;
  write_yolo(folder);
  write_text(folder / "yolo.yaml",
             "schema: segsim.model/1\ntask: yolo\nfiles: {model: yolo.onnx}\n"
             "class_names: [a, b, c, d, e, f, g, h, i, j, k, l, m]\n");
  const auto detector = load_object_detector(folder / "yolo.yaml");
  EXPECT_THAT(message_of([&] { (void)detect(*detector, wide_picture()); }),
              HasSubstr("for its 13 classes, found [1, 6, 16]"));
  write_text(folder / "bad.yaml",
             "schema: segsim.model/1\ntask: yolo\nfiles: {model: yolo.onnx}\nclasses: [a]\n");
  EXPECT_THAT(message_of([&] { (void)load_object_detector(folder / "bad.yaml"); }),
              HasSubstr("bad.yaml:4: expected a known key, found \"classes\""));
  GraphBuilder nameless(12);
  add_cell_head(nameless, "output0");
  nameless.output("output0");
  for (const char* names : {"", "{0: 'a', 2: 'b'}", "['a']", "{0: 'a"}) {
    GraphBuilder builder = nameless;
    if (*names != '\0') builder.metadata("names", names);
    builder.save(folder / "names.onnx");
    EXPECT_NE(message_of([&] { (void)load_object_detector(folder / "names.onnx"); }), "")
        << names;
  }
}

constexpr const char* kVocabulary =
    "[PAD]\n[UNK]\n[CLS]\n[SEP]\n.\nchair\noffice\ntable\n##s\n";  // 0 to 8

/// Two queries; the logit of token t at query q is +4 where the token's id is q's, else -4.
/// The boxes are fixed; input names as in Hugging Face's export.
std::filesystem::path write_grounding_dino(const TestFolder& folder,
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
  const TestFolder folder;
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
  const TestFolder folder;
  const auto model = write_grounding_dino(folder, {5});
  EXPECT_THAT(message_of([&] { (void)load_object_detector(model); }),
              HasSubstr("a text prompt"));
  write_text(folder / "vocab.txt", "chair\n");
  ObjectDetectorOptions options;
  options.prompts = {"chair"};
  EXPECT_THAT(message_of([&] { (void)load_object_detector(model, options); }),
              HasSubstr("[CLS]"));
}

TEST(Prompt, IsSplitAtDots) {
  EXPECT_THAT(parse_prompt(" Chair. office  desk . "),
              testing::ElementsAre("chair", "office  desk"));
  EXPECT_THROW((void)parse_prompt(" . "), core::InputError);
  EXPECT_THROW((void)parse_prompt("a. A"), core::InputError);
}

/// The decoder paints the box it was given: masks [1, 1, h, w] of the original size as the
/// official export does, or 16 x 16 of the square.
class SamModel : public testing::Test {
 protected:
  void write_encoder() {
    GraphBuilder builder(17);
    builder.input("x", {1, 3, 64, 64});
    builder.node("AveragePool", {"x"}, {"image_embeddings"})
        .with("kernel_shape", Ints{16, 16})
        .with("strides", Ints{16, 16});
    builder.output("image_embeddings");
    builder.save(folder_ / "encoder.onnx");
    write_text(folder_ / "sam.yaml",
               "schema: segsim.model/1\ntask: sam\n"
               "files: {encoder: encoder.onnx, decoder: decoder.onnx}\n");
  }

  /// min(x - x0, x1 - x, y - y0, y1 - y) at the centres of a 16 x 16 grid over the square.
  /// @param corners  The input that has them: "point_coords", or "input_boxes" as Hugging Face
  ///                 calls it.
  void write_decoder(const std::string& corners = "point_coords") {
    GraphBuilder builder(17);
    builder.input("image_embeddings", {1, 3, 4, 4});
    const bool boxes = corners == "input_boxes";
    if (boxes) {
      builder.input("input_boxes", {1, 1, 4});
      builder.input("input_points", {1, 1, -1, 2});
      builder.input("input_labels", {1, 1, -1}, kInt64Type);
    } else {
      builder.input("point_coords", {1, -1, 2});
      builder.input("point_labels", {1, -1});
      builder.input("mask_input", {1, 1, 256, 256});
      builder.input("has_mask_input", {1});
    }
    Floats xs(256), ys(256);
    for (std::size_t i = 0; i < 256; ++i) {
      xs[i] = (static_cast<float>(i % 16) + 0.5F) * 4;
      ys[i] = (static_cast<float>(i / 16) + 0.5F) * 4;
    }
    builder.floats("xs", {1, 1, 16, 16}, xs);
    builder.floats("ys", {1, 1, 16, 16}, ys);
    builder.ints("four", {4});
    builder.node("Reshape", {corners, "four"}, {"corners"});
    builder.node("Split", {"corners"}, {"x0", "y0", "x1", "y1"}).with("axis", 0);
    builder.node("Sub", {"xs", "x0"}, {"left"});
    builder.node("Sub", {"x1", "xs"}, {"right"});
    builder.node("Sub", {"ys", "y0"}, {"above"});
    builder.node("Sub", {"y1", "ys"}, {"below"});
    builder.node("Min", {"left", "right", "above", "below"}, {"one_mask"});
    builder.node("Neg", {"one_mask"}, {"outside"});
    builder.node("Concat", {"outside", "one_mask"}, {"low_res_masks"}).with("axis", 1);
    if (boxes) {
      builder.node("Cast", {"input_labels"}, {"labels"}).with("to", kFloatType);
    } else {
      builder.node("Identity", {"point_labels"}, {"labels"});
    }
    builder.node("ReduceMean", {"labels"}, {"label"}).with("keepdims", 0);  // 2.5, or -10.
    builder.floats("factors", {1, 2}, boxes ? Floats{-0.01F, -0.09F} : Floats{0.1F, 0.36F});
    builder.node("Mul", {"factors", "label"}, {"iou_predictions"});
    builder.output("iou_predictions");
    builder.output("low_res_masks");
    builder.save(folder_ / "decoder.onnx");
  }

  void expect_boxes();

  TestFolder folder_;
};

void SamModel::expect_boxes() {
  const auto segmenter = load_prompt_segmenter(folder_ / "sam.yaml");
  const Image<Rgb8> image(128, 96);  // Scale 0.5: the square is filled to row 48.
  const std::vector<core::BoxPx> boxes{{16, 24, 80, 64}, {64, 0, 128, 96}};
  const auto masks = segmenter->segment(image, boxes);
  ASSERT_EQ(masks.size(), 2U);
  EXPECT_NEAR(masks[0].predicted_iou, 0.9F, 1e-5F);
  for (std::size_t m = 0; m < 2; ++m) {
    const core::BoxPx& box = boxes[m];
    int wrong = 0;
    for (int y = 0; y < 96; ++y) {
      for (int x = 0; x < 128; ++x) {
        const auto fx = static_cast<float>(x) + 0.5F, fy = static_cast<float>(y) + 0.5F;
        const float depth =
            std::min(std::min(fx - box.x0, box.x1 - fx), std::min(fy - box.y0, box.y1 - fy));
        if (std::abs(depth) < 4.5F) continue;  // Half a cell of the mask: 4 px.
        wrong += (masks[m].inside(x, y) == 1) == (depth > 0) ? 0 : 1;
      }
    }
    EXPECT_EQ(wrong, 0);
  }
  EXPECT_TRUE(segmenter->segment(image, {}).empty());
}

TEST_F(SamModel, MaskOfABoxIsTheBox) {
  write_encoder();
  write_decoder();
  expect_boxes();
}

TEST_F(SamModel, BoxesOfHuggingFacesDecoderHaveAnInputOfTheirOwn) {
  write_encoder();
  write_decoder("input_boxes");
  expect_boxes();
  GraphBuilder points(17);
  points.input("image_embeddings", {1, 3, 4, 4});
  points.input("input_points", {1, 1, -1, 2});
  points.node("Identity", {"input_points"}, {"pred_masks"});
  points.output("pred_masks");
  points.save(folder_ / "decoder.onnx");
  EXPECT_THAT(message_of([&] { (void)load_prompt_segmenter(folder_ / "sam.yaml"); }),
              HasSubstr("input_points alone, which take no box"));
}

TEST_F(SamModel, OtherSignaturesAreRefused) {
  write_encoder();
  std::filesystem::copy_file(folder_ / "encoder.onnx", folder_ / "decoder.onnx");
  EXPECT_THAT(message_of([&] { (void)load_prompt_segmenter(folder_ / "sam.yaml"); }),
              HasSubstr("point_coords or input_boxes"));
  EXPECT_THAT(message_of([&] { (void)load_prompt_segmenter(folder_ / "encoder.onnx"); }),
              HasSubstr("task sam"));
}

/// Image tower: mean colour after CLIP's normalisation. Text tower: a direction per id of the
/// second token, so that "chair" (5) looks red and "table" (7) blue.
std::filesystem::path write_clip(const TestFolder& folder, const std::string& task) {
  GraphBuilder image(17);
  image.input("pixel_values", {1, 3, 8, 8});
  image.node("GlobalAveragePool", {"pixel_values"}, {"pooled"});
  image.node("Flatten", {"pooled"}, {"image_embeds"});
  image.output("image_embeds");
  image.save(folder / "image.onnx");
  GraphBuilder text(17);
  text.input("input_ids", {1, 6}, kInt64Type);
  text.input("attention_mask", {1, 6}, kInt64Type);
  Floats directions(27, 0.1F);
  directions[5 * 3] = 1;
  directions[7 * 3 + 2] = 1;
  text.floats("table", {9, 3}, directions);
  text.ints("second", {1});
  text.node("Gather", {"input_ids", "second"}, {"id"}).with("axis", 1);
  text.node("Gather", {"table", "id"}, {"row"});
  text.ints("flat", {1, 3});
  text.node("Reshape", {"row", "flat"}, {"text_embeds"});
  text.output("text_embeds");
  text.save(folder / "text.onnx");
  write_text(folder / "vocab.txt", kVocabulary);
  write_text(folder / "clip.yaml",
             "schema: segsim.model/1\ntask: " + task +
                 "\nfiles: {image: image.onnx, text: text.onnx, "
                 "tokenizer: vocab.txt}\n" +
                 (task == "siglip" ? "logit_scale: 2\nlogit_bias: -1\n" : ""));
  return folder / "clip.yaml";
}

TEST(ClipModel, CosineOfPictureAndText) {
  const TestFolder folder;
  const auto scorer = load_image_text_scorer(write_clip(folder, "clip"));
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
  const TestFolder folder;
  const auto scorer = load_image_text_scorer(write_clip(folder, "siglip"));
  const auto scores = scorer->scores(Image<Rgb8>(8, 8, {255, 0, 0}), {"chair"});
  const double cosine = (1 - 0.1 - 0.1) / std::sqrt(3.0) / std::sqrt(1.02);
  EXPECT_NEAR(scores.at(0), 1 / (1 + std::exp(-(2 * cosine - 1))), 1e-5);
}

TEST(ClipModel, MatcherGivesTheProbabilityOfAMatch) {
  const TestFolder folder;
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
