#include "perception/training/internal/augmentation.h"

#include <gtest/gtest.h>

#include "perception/data/letterbox.h"
#include "tests/perception/training_pictures.h"

namespace segsim::perception {
namespace {

using core::BoxPx;
using core::Image;
using core::Rgb8;

constexpr int kSide_px = 96;
constexpr Rgb8 kRed{255, 0, 0}, kGreen{0, 255, 0};

/// Tight box of the pixels that are more than half of the colour's one channel.
BoxPx find(const Image<Rgb8>& image, Rgb8 colour) {
  BoxPx found{1e9F, 1e9F, -1.0F, -1.0F};
  for (int y = 0; y < image.height_px(); ++y) {
    for (int x = 0; x < image.width_px(); ++x) {
      const Rgb8 pixel = image(x, y);
      // Grey is 114 in every channel, so the other channel tells it apart.
      const int own = colour.r != 0 ? pixel.r : pixel.g,
                other = colour.r != 0 ? pixel.g : pixel.r;
      if (own - other <= 127) continue;
      found = {std::min(found.x0, float(x)), std::min(found.y0, float(y)),
               std::max(found.x1, float(x + 1)), std::max(found.y1, float(y + 1))};
    }
  }
  return found;
}

void expect_near(const BoxPx& a, const BoxPx& b, float tolerance_px) {
  EXPECT_NEAR(a.x0, b.x0, tolerance_px);
  EXPECT_NEAR(a.y0, b.y0, tolerance_px);
  EXPECT_NEAR(a.x1, b.x1, tolerance_px);
  EXPECT_NEAR(a.y1, b.y1, tolerance_px);
}

Sample rectangle(const BoxPx& box, Rgb8 colour, int class_index, const BoxPx& content) {
  Sample sample{Image<Rgb8>(kSide_px, kSide_px, {114, 114, 114}), {}, content};
  paint(sample.square, content, {40, 40, 40});
  paint(sample.square, box, colour);
  LabeledBox label;
  label.class_index = class_index;
  label.box = box;
  sample.boxes = {label};
  return sample;
}

TEST(Augmentation, WarpedBoxesLieOnTheWarpedRectangles) {
  const Sample sample = rectangle({30, 24, 62, 70}, kRed, 0, {0, 0, kSide_px, kSide_px});
  Augmentation ranges;
  ranges.flip = 0.5;
  int flips = 0, cut = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    core::RandomStream random(seed, "test");
    ranges.log_scale = seed % 2 == 0;
    ranges.shift = seed % 3 == 0 ? 0.6 : 0.15;
    const Warp warp = draw_warp(random, ranges, kSide_px, kSide_px);
    EXPECT_GE(warp.scale, ranges.scale_min);
    EXPECT_LE(warp.scale, ranges.scale_max);
    flips += warp.flip ? 1 : 0;
    const auto boxes = warp_boxes(sample.boxes, warp, ranges.min_kept_share);
    const BoxPx seen = find(warp.apply(sample.square), kRed);
    if (boxes.empty()) {
      EXPECT_LE(seen.x1, 1.0F) << seed;  // At most a blurred seam of it is left.
      continue;
    }
    if (boxes[0].ignore) {
      ++cut;
      continue;
    }
    expect_near(boxes[0].box, seen, 1.01F);
  }
  EXPECT_GT(flips, 15);
  EXPECT_LT(flips, 45);
  EXPECT_GT(cut, 0);
}

TEST(Augmentation, FlipMirrors) {
  Warp warp;
  warp.from_px = warp.to_px = kSide_px;
  warp.flip = true;
  const BoxPx mirrored = warp.apply(BoxPx{10, 20, 30, 50});
  EXPECT_EQ(mirrored.x0, 66.0F);
  EXPECT_EQ(mirrored.x1, 86.0F);
  EXPECT_EQ(mirrored.y0, 20.0F);
  EXPECT_EQ(mirrored.y1, 50.0F);
}

TEST(Augmentation, MosaicPutsFourPicturesAroundTheCentreWithTheirBoxes) {
  const BoxPx whole{0, 0, kSide_px, kSide_px}, band{0, 12, kSide_px, 84};
  const Sample red = rectangle({8, 20, 40, 52}, kRed, 0, whole);
  const Sample green = rectangle({50, 40, 90, 80}, kGreen, 1, band);  // With bars.
  const Sample none{Image<Rgb8>(kSide_px, kSide_px, {40, 40, 40}), {}, whole};
  const Sample mosaic = compose_mosaic({&none, &red, &green, &none}, 100, 80, 0.2);
  ASSERT_EQ(mosaic.square.width_px(), 2 * kSide_px);
  ASSERT_EQ(mosaic.boxes.size(), 2U);
  // Top right: its lower left corner is the centre. Bottom left: its upper right corner.
  expect_near(mosaic.boxes[0].box, {108, 4, 140, 36}, 0.0F);
  expect_near(mosaic.boxes[1].box, {54, 108, 94, 148}, 0.0F);
  EXPECT_EQ(mosaic.boxes[1].class_index, 1);
  expect_near(find(mosaic.square, kRed), mosaic.boxes[0].box, 0.0F);
  expect_near(find(mosaic.square, kGreen), mosaic.boxes[1].box, 0.0F);

  // A centre so far to the corner that most of the first picture's box is outside.
  const Sample corner = compose_mosaic({&red, &none, &none, &none}, 60, 60, 0.2);
  ASSERT_EQ(corner.boxes.size(), 1U);
  expect_near(corner.boxes[0].box, {0, 0, 4, 16}, 0.0F);
  EXPECT_TRUE(corner.boxes[0].ignore);
  expect_near(find(corner.square, kRed), {0, 0, 4, 16}, 0.0F);

  // Back to one picture's size around the mosaic's middle.
  Warp warp;
  warp.from_px = 2 * kSide_px;
  warp.to_px = kSide_px;
  warp.scale = 0.5;
  const auto boxes = warp_boxes(mosaic.boxes, warp, 0.2);
  const Image<Rgb8> small = warp.apply(mosaic.square);
  expect_near(find(small, kRed), boxes[0].box, 1.01F);
  expect_near(find(small, kGreen), boxes[1].box, 1.01F);
}

TEST(Augmentation, HsvFactorsActOnTheirOwnChannels) {
  Image<Rgb8> image(3, 1);
  image(0, 0) = {200, 100, 100};
  image(1, 0) = {90, 90, 90};
  image(2, 0) = {0, 160, 0};
  Image<Rgb8> same = image;
  scale_hsv(same, 1.0, 1.0, 1.0);
  for (int x = 0; x < 3; ++x) {
    EXPECT_NEAR(same(x, 0).r, image(x, 0).r, 2);
    EXPECT_NEAR(same(x, 0).g, image(x, 0).g, 2);
  }
  Image<Rgb8> changed = image;
  scale_hsv(changed, 1.0, 0.5, 1.0);  // Halfway to grey; the largest channel stays.
  EXPECT_NEAR(changed(0, 0).r, 200, 2);
  EXPECT_NEAR(changed(0, 0).g, 150, 3);
  EXPECT_NEAR(changed(1, 0).b, 90, 2);
  changed = image;
  scale_hsv(changed, 1.0, 1.0, 0.5);
  EXPECT_NEAR(changed(0, 0).r, 100, 2);
  EXPECT_NEAR(changed(1, 0).g, 45, 2);
  changed = image;
  scale_hsv(changed, 1.5, 1.0, 1.0);  // Green (120 degrees) to cyan (180).
  EXPECT_NEAR(changed(2, 0).r, 0, 3);
  EXPECT_NEAR(changed(2, 0).g, 160, 3);
  EXPECT_NEAR(changed(2, 0).b, 160, 3);
}

}  // namespace
}  // namespace segsim::perception
