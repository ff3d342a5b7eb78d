#include "perception/data/letterbox.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/error.h"
#include "perception/data/image_file.h"
#include "perception/training/internal/batch_source.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using core::Image;
using core::Rgb8;

TEST(Letterbox, BoxesReturnToThemselves) {
  for (const auto& [w, h] :
       {std::pair{640, 480}, {480, 640}, {1280, 301}, {100, 100}, {31, 7}}) {
    const Letterbox fit = Letterbox::fit(w, h, 256);
    const core::BoxPx box{0.1F * static_cast<float>(w), 0.2F * static_cast<float>(h),
                          0.9F * static_cast<float>(w), 1.0F * static_cast<float>(h)};
    const core::BoxPx back = fit.to_image(fit.to_square(box));
    const float tolerance = 1e-5F * static_cast<float>(std::max(w, h));
    EXPECT_NEAR(back.x0, box.x0, tolerance);
    EXPECT_NEAR(back.y0, box.y0, tolerance);
    EXPECT_NEAR(back.x1, box.x1, tolerance);
    EXPECT_NEAR(back.y1, box.y1, tolerance);
    EXPECT_NEAR(fit.scale_x, fit.scale_y, 0.5 / std::min(w, h) + 0.02);
  }
}

TEST(Letterbox, PicturePartsLieWhereTheBoxesSay) {
  // A white rectangle on black: its edges in the square are where to_square() puts them.
  Image<Rgb8> image(640, 480);
  for (int y = 100; y < 300; ++y) {
    for (int x = 200; x < 500; ++x) image(x, y) = {255, 255, 255};
  }
  const Letterbox fit = Letterbox::fit(640, 480, 256);
  const Image<Rgb8> square = letterbox(image, fit);
  const core::BoxPx box = fit.to_square({200, 100, 500, 300});
  EXPECT_EQ(fit.offset_y_px, 32);
  EXPECT_EQ(square(10, 31), (Rgb8{kLetterboxGrey, kLetterboxGrey, kLetterboxGrey}));
  EXPECT_EQ(square(10, 32), (Rgb8{0, 0, 0}));
  double area = 0.0;
  for (int y = 32; y < 224; ++y) {
    for (int x = 0; x < 256; ++x) area += square(x, y).g / 255.0;
  }
  EXPECT_NEAR(area, box.area_px2(), 0.01 * box.area_px2());
  EXPECT_EQ(square(static_cast<int>(box.x0) - 2, 100).g, 0);
  EXPECT_EQ(square(static_cast<int>(box.x0) + 2, 100).g, 255);
}

TEST(ImageFile, RedTestCardStaysRed) {
  const tests::TemporaryFolder folder;
  Image<Rgb8> card(32, 16, {250, 20, 5});
  card(3, 2) = {1, 2, 3};
  write_image(folder / "card.png", card);
  const Image<Rgb8> read = read_image(folder / "card.png");
  EXPECT_EQ(read.width_px(), 32);
  EXPECT_EQ(read.pixels(), card.pixels());
  EXPECT_THROW((void)read_image(folder / "none.png"), core::InputError);
  EXPECT_THROW(write_image(folder / "card.what", card), core::InputError);
}

/// A dataset of one image: a red rectangle on black.
CocoDataset red_rectangle(const tests::TemporaryFolder& folder) {
  Image<Rgb8> image(64, 64);
  for (int y = 16; y < 48; ++y) {
    for (int x = 20; x < 40; ++x) image(x, y) = {255, 0, 0};
  }
  write_image(folder / "a.png", image);
  CocoDataset dataset;
  dataset.folder = folder / "";
  dataset.class_names = {"red"};
  LabeledBox label;
  label.box = {20, 16, 40, 48};
  dataset.images = {{1, "a.png", 64, 64, {label}}};
  return dataset;
}

TEST(BatchSource, ChannelsAreRedGreenBlue) {
  const tests::TemporaryFolder folder;
  const BatchSource source(red_rectangle(folder), nullptr, {64, 1, 0.0, false, 1});
  Batch batch;
  source.make(0, batch);
  const std::size_t plane = 64 * 64, centre = 32 * 64 + 30;
  EXPECT_EQ(batch.pixels[centre], 1.0F);
  EXPECT_EQ(batch.pixels[plane + centre], 0.0F);
  EXPECT_EQ(batch.pixels[2 * plane + centre], 0.0F);
}

TEST(BatchSource, AugmentedBoxesFollowTheirPixels) {
  const tests::TemporaryFolder folder;
  const BatchSource source(red_rectangle(folder), nullptr, {64, 4, 0.0, true, 5});
  Batch batch;
  int compared = 0;
  for (int step = 0; step < 25; ++step) {
    source.make(step, batch);
    for (std::size_t image = 0; image < 4; ++image) {
      if (batch.truth[image].empty()) continue;
      const core::BoxPx box = batch.truth[image][0].box;
      // Extents of the pixels that are more red than green by half of the rectangle's
      // difference.
      const float* red = batch.pixels.data() + image * 3 * 64 * 64;
      float strongest = 0.0F;
      for (int i = 0; i < 64 * 64; ++i)
        strongest = std::max(strongest, red[i] - red[i + 64 * 64]);
      float x0 = 64, y0 = 64, x1 = 0, y1 = 0;
      for (int y = 0; y < 64; ++y) {
        for (int x = 0; x < 64; ++x) {
          const int i = y * 64 + x;
          if (red[i] - red[i + 64 * 64] < 0.5F * strongest) continue;
          x0 = std::min(x0, static_cast<float>(x));
          y0 = std::min(y0, static_cast<float>(y));
          x1 = std::max(x1, static_cast<float>(x + 1));
          y1 = std::max(y1, static_cast<float>(y + 1));
        }
      }
      EXPECT_NEAR(box.x0, x0, 1.01);
      EXPECT_NEAR(box.y0, y0, 1.01);
      EXPECT_NEAR(box.x1, x1, 1.01);
      EXPECT_NEAR(box.y1, y1, 1.01);
      ++compared;
    }
  }
  EXPECT_GT(compared, 90);
}

TEST(BatchSource, StepIsTheOnlyState) {
  const tests::TemporaryFolder folder;
  const CocoDataset dataset = red_rectangle(folder);
  const BatchSource a(dataset, nullptr, {64, 2, 0.0, true, 5});
  const BatchSource b(dataset, nullptr, {64, 2, 0.0, true, 5});
  Batch first, second;
  a.make(0, first);
  a.make(7, first);
  b.make(7, second);
  EXPECT_EQ(first.pixels, second.pixels);
  b.make(8, second);
  EXPECT_NE(first.pixels, second.pixels);
}

TEST(BatchSource, BatchesDoNotDependOnWhatIsInMemory) {
  const tests::TemporaryFolder folder;
  CocoDataset dataset = red_rectangle(folder);
  for (int i = 2; i <= 3; ++i) {  // Pictures of their own, so that a mix-up shows.
    const std::string name = std::to_string(i) + ".png";
    write_image(folder / name, Image<Rgb8>(64, 64, {0, static_cast<std::uint8_t>(60 * i), 9}));
    dataset.images.push_back(dataset.images[0]);
    dataset.images.back().id = i;
    dataset.images.back().file = name;
  }
  BatchOptions options{64, 4, 0.25, true, {}, 100, 5};
  options.augmentation.mosaic = 0.5;
  constexpr std::int64_t kOneImage = 64 * 64 * 3;
  std::vector<Batch> batches;
  // All pictures, those of the first set but one, and none.
  for (const std::int64_t bytes :
       {std::int64_t{1} << 30, 2 * kOneImage + 1, std::int64_t{0}}) {
    options.cache_bytes = bytes;
    const BatchSource source(dataset, &dataset, options);
    for (int step = 0; step < 6; ++step) source.make(step, batches.emplace_back());
  }
  for (std::size_t i = 6; i < batches.size(); ++i) {
    EXPECT_EQ(batches[i].pixels, batches[i % 6].pixels);
    EXPECT_EQ(batches[i].truth.size(), batches[i % 6].truth.size());
  }
  EXPECT_NE(batches[0].pixels, batches[1].pixels);
}

TEST(BatchSource, MixesAShareOfASecondSet) {
  const tests::TemporaryFolder folder;
  const CocoDataset main = red_rectangle(folder);
  CocoDataset mix = main;
  mix.images[0].boxes[0].visible_fraction = 0.5;  // Tells them apart.
  const BatchSource source(main, &mix, {64, 8, 0.25, false, 5});
  Batch batch;
  source.make(3, batch);
  int mixed = 0;
  for (const auto& truth : batch.truth) mixed += truth[0].visible_fraction.has_value() ? 1 : 0;
  EXPECT_EQ(mixed, 2);
}

TEST(BatchSource, ImageOfAnotherSizeIsRefused) {
  const tests::TemporaryFolder folder;
  CocoDataset dataset = red_rectangle(folder);
  dataset.images[0].width_px = 65;
  EXPECT_THROW(BatchSource(dataset, nullptr, {64, 1, 0.0, false, 1}), core::InputError);
}

}  // namespace
}  // namespace segsim::perception
