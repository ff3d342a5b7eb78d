#include "perception/models/depth_estimator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "tests/perception/depth_model.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using core::Image;
using core::Rgb8;
using testing::HasSubstr;

TEST(DepthModel, EveryPixelHasItsDepth) {
  const tests::TemporaryFolder folder;
  const auto estimator = load_depth_estimator(write_depth_model(folder / ""));
  Image<Rgb8> image(64, 32, {255, 255, 255});
  for (int y = 0; y < 32; ++y) {
    for (int x = 32; x < 64; ++x) image(x, y) = {0, 0, 0};
  }
  Image<float> depth_m;
  estimator->infer(image, depth_m);
  ASSERT_EQ(depth_m.width_px(), 64);
  ASSERT_EQ(depth_m.height_px(), 32);
  for (const int y : {0, 15, 31}) {
    EXPECT_NEAR(depth_m(0, y), 1.0F, 1e-6F);
    EXPECT_NEAR(depth_m(20, y), 1.0F, 1e-6F);
    EXPECT_NEAR(depth_m(36, y), 0.0F, 1e-6F);
    EXPECT_NEAR(depth_m(63, y), 0.0F, 1e-6F);
    // The input's pixels are 4 px wide. The last white one (middle 30) takes an eighth of
    // black: 0.75 m. The next one (middle 34) is at 0 m. 31.5 lies 3/8 of the way.
    EXPECT_NEAR(depth_m(31, y), 0.625F * 0.75F, 0.005F);
  }
}

TEST(DepthModel, AnAnswerThatIsNoDepthIsRefused) {
  const tests::TemporaryFolder folder;
  const std::filesystem::path model = write_depth_model(folder / "");
  Image<float> depth_m;
  {
    GraphBuilder graph(17);
    graph.input("pixel_values", {1, 3, 8, 16});
    graph.node("ReduceMean", {"pixel_values"}, {"predicted_depth"}).with("axes", Ints{1});
    graph.output("predicted_depth");
    graph.save(folder / "depth.onnx");
  }
  const auto negative = load_depth_estimator(model);
  EXPECT_THAT(tests::input_error_of([&] { negative->infer(Image<Rgb8>(8, 8), depth_m); }),
              HasSubstr("depths in metres"));
  {
    GraphBuilder graph(17);
    graph.input("pixel_values", {1, 3, 8, 16});
    graph.node("Relu", {"pixel_values"}, {"predicted_depth"});
    graph.output("predicted_depth");
    graph.save(folder / "depth.onnx");
  }
  const auto three = load_depth_estimator(model);
  EXPECT_THAT(tests::input_error_of([&] { three->infer(Image<Rgb8>(8, 8), depth_m); }),
              HasSubstr("[1, h, w]"));
  write_text(folder / "depth.yaml",
             "schema: segsim.model/1\ntask: sam\nfiles: {model: depth.onnx}\n");
  EXPECT_THAT(tests::input_error_of([&] { (void)load_depth_estimator(model); }),
              HasSubstr("task depth"));
}

}  // namespace
}  // namespace segsim::perception
