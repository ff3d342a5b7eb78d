#include "perception/models/object_detector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>

#include "core/error.h"
#include "tests/perception/model_files.h"
#include "tests/perception/models/onnx_operator_case.h"
#include "tests/perception/tiny_models.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using core::Image;
using core::Rgb8;
using testing::HasSubstr;

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
  const tests::TemporaryFolder folder;
  const auto detector = load_object_detector(write_yolo(folder / ""), above_half());
  EXPECT_THAT(detector->class_names(), testing::ElementsAre("chair", "cat's bed"));
  expect_wide_picture(detect(*detector, wide_picture()));
}

TEST(YoloModel, SuppressionInsideTheGraph) {
  // The same head, transposed, NonMaxSuppression and gathering: [n, 7], as exporters of v7 do.
  const tests::TemporaryFolder folder;
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
  const tests::TemporaryFolder folder;
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
  EXPECT_THAT(tests::input_error_of([&] { (void)detect(*detector, wide_picture()); }),
              HasSubstr("expected an output [1, 6, n] (exported without nms), since for 2 "
                        "classes six columns"));
}

TEST(YoloModel, PromptsChooseAndOrderItsClasses) {
  const tests::TemporaryFolder folder;
  ObjectDetectorOptions options = above_half();
  options.prompts = {"cat's bed"};
  const auto detector = load_object_detector(write_yolo(folder / ""), options);
  const auto found = detect(*detector, wide_picture());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].class_index, 0);
  options.prompts = {"sofa"};
  EXPECT_THAT(tests::input_error_of(
                  [&] { (void)load_object_detector(folder / "yolo.onnx", options); }),
              HasSubstr("'sofa', which it does not have"));
}

TEST(YoloModel, SizesOfPicturesFromOnePixelOn) {
  const tests::TemporaryFolder folder;
  const auto detector = load_object_detector(write_yolo(folder / ""), above_half());
  EXPECT_EQ(detect(*detector, Image<Rgb8>(1, 1, {255, 0, 0})).size(), 16U);
  EXPECT_NO_THROW((void)detect(*detector, Image<Rgb8>(3000, 2)));
}

TEST(YoloModel, OtherOutputsAndNamesAreRefused) {
  const tests::TemporaryFolder folder;
  write_yolo(folder / "");
  write_text(folder / "yolo.yaml",
             "schema: segsim.model/1\ntask: yolo\nfiles: {model: yolo.onnx}\n"
             "class_names: [a, b, c, d, e, f, g, h, i, j, k, l, m]\n");
  const auto detector = load_object_detector(folder / "yolo.yaml");
  EXPECT_THAT(tests::input_error_of([&] { (void)detect(*detector, wide_picture()); }),
              HasSubstr("for its 13 classes, found [1, 6, 16]"));
  write_text(folder / "bad.yaml",
             "schema: segsim.model/1\ntask: yolo\nfiles: {model: yolo.onnx}\nclasses: [a]\n");
  EXPECT_THAT(tests::input_error_of([&] { (void)load_object_detector(folder / "bad.yaml"); }),
              HasSubstr("bad.yaml:4: expected a known key, found \"classes\""));
  GraphBuilder nameless(12);
  add_cell_head(nameless, "output0");
  nameless.output("output0");
  for (const char* names : {"", "{0: 'a', 2: 'b'}", "['a']", "{0: 'a"}) {
    GraphBuilder builder = nameless;
    if (*names != '\0') builder.metadata("names", names);
    builder.save(folder / "names.onnx");
    EXPECT_NE(
        tests::input_error_of([&] { (void)load_object_detector(folder / "names.onnx"); }),
        "no error")
        << names;
  }
}

}  // namespace
}  // namespace segsim::perception
