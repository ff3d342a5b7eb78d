#include "perception/models/prompt_segmenter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

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

class SamModel : public testing::Test {
 protected:
  void write_encoder() { write_sam_encoder(folder_ / ""); }
  void write_decoder(const std::string& corners = "point_coords") {
    write_sam_decoder(folder_ / "", corners);
  }
  void expect_boxes();

  tests::TemporaryFolder folder_;
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
  EXPECT_THAT(
      tests::input_error_of([&] { (void)load_prompt_segmenter(folder_ / "sam.yaml"); }),
      HasSubstr("input_points alone, which take no box"));
}

TEST_F(SamModel, OtherSignaturesAreRefused) {
  write_encoder();
  std::filesystem::copy_file(folder_ / "encoder.onnx", folder_ / "decoder.onnx");
  EXPECT_THAT(
      tests::input_error_of([&] { (void)load_prompt_segmenter(folder_ / "sam.yaml"); }),
      HasSubstr("point_coords or input_boxes"));
  EXPECT_THAT(
      tests::input_error_of([&] { (void)load_prompt_segmenter(folder_ / "encoder.onnx"); }),
      HasSubstr("task sam"));
}

}  // namespace
}  // namespace segsim::perception
