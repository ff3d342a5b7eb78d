#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "core/error.h"
#include "reconstruction/labels/panoptic_training.h"
#include "reconstruction/labels/pixel_sampling.h"
#include "reconstruction/labels/query_pruning.h"
#include "reconstruction/labels/query_seeding.h"

namespace segsim::reconstruction {
namespace {

const core::CameraIntrinsics kCamera = core::CameraIntrinsics::from_fov(40, 30, 1.0);
const core::CameraPose kPose = core::look_at({1.0, 2.0, 1.0}, {4.0, 2.0, 1.0});

core::FrameMasks masks_of(int width_px = 40, int height_px = 30) {
  core::FrameMasks masks;
  masks.semantic = core::Image<std::uint16_t>(width_px, height_px, std::uint16_t{0});
  masks.instance = masks.semantic;
  return masks;
}

void fill(core::FrameMasks& masks, int x0, int x1, std::uint16_t semantic,
          std::uint16_t instance) {
  for (int y = 0; y < masks.semantic.height_px(); ++y) {
    for (int x = x0; x < x1; ++x) {
      masks.semantic(x, y) = semantic;
      masks.instance(x, y) = instance;
    }
  }
}

TEST(QuerySeeding, SeedsLieOnTheMasksSurfacesApartByClass) {
  core::FrameMasks masks = masks_of();
  fill(masks, 18, 20, 3, 5);
  fill(masks, 20, 22, 4, 6);
  fill(masks, 0, 5, 1, 0);  // Stuff gives no seeds.
  const core::Image<float> depth_m(40, 30, 2.0F);
  PanopticTrainingConfig config;
  config.query.min_queries_per_mask = 0.0;
  config.query.seed_voxel_m = 100.0;  // One voxel about each sign of the coordinates.
  QuerySeeder seeder(config, 1);
  for (int frame = 0; frame < 5; ++frame)
    seeder.add_frame(frame, masks, depth_m, kCamera, kPose);
  const std::vector<glm::vec3> seeds = seeder.seeds_m();
  std::set<int> sides;
  for (const glm::vec3& p : seeds) {
    EXPECT_NEAR(p.x, 3.0, 1e-5);  // Two metres before the camera, which looks along +x.
    EXPECT_NEAR(p.y, 2.0, 0.2);
    EXPECT_LT(std::abs(p.z - 1.0F), 0.9F);
    sides.insert(p.y > 2.0F ? 1 : -1);
  }
  EXPECT_EQ(sides.size(), 2U);
}

TEST(QuerySeeding, CountsStayBetweenTheirBounds) {
  core::FrameMasks masks = masks_of();
  for (int i = 0; i < 8; ++i)
    fill(masks, 5 * i, 5 * i + 5, 3, static_cast<std::uint16_t>(i + 1));
  const core::Image<float> depth_m(40, 30, 1.0F);
  PanopticTrainingConfig config;
  config.query.seed_voxel_m = 50.0;  // All in one voxel: too few for eight masks.
  QuerySeeder few(config, 1);
  few.add_frame(0, masks, depth_m, kCamera, kPose);
  EXPECT_GE(few.seeds_m().size(), 16U);
  config.query.seed_voxel_m = 0.001;
  config.query.max_queries = 10;
  QuerySeeder many(config, 1);
  for (int frame = 0; frame < 5; ++frame)
    many.add_frame(frame, masks, depth_m, kCamera, kPose);
  EXPECT_EQ(many.seeds_m().size(), 10U);
  EXPECT_EQ(many.seeds_m(), many.seeds_m());
}

TEST(QuerySeeding, PixelsWithoutDepthGiveNothing) {
  core::FrameMasks masks = masks_of();
  fill(masks, 0, 40, 3, 1);
  QuerySeeder seeder({}, 1);
  seeder.add_frame(0, masks, core::Image<float>(40, 30, std::nanf("")), kCamera, kPose);
  seeder.add_frame(1, masks, core::Image<float>(40, 30, 0.2F), kCamera, kPose);
  EXPECT_TRUE(seeder.seeds_m().empty());
}

QueryUse use(std::int64_t matches, std::int64_t recent, std::int64_t frames,
             std::vector<std::int64_t> surfels = {}) {
  return {matches, recent, frames, std::move(surfels)};
}

TEST(QueryPruning, UnmatchedAndRareQueriesGo) {
  const std::vector<QueryUse> uses{use(9, 2, 5), use(9, 0, 5), use(9, 2, 2), use(3, 1, 3)};
  EXPECT_EQ(queries_to_keep(uses, {}), (std::vector<std::int64_t>{0, 3}));
}

TEST(QueryPruning, OfTwoThatOverlapTheLessMatchedGoes) {
  // 8 of the smaller one's 10 surfels: more than 0.7. The third shares 7 of 10.
  const std::vector<QueryUse> uses{use(5, 1, 5, {0, 1, 2, 3, 4, 5, 6, 7, 20, 21}),
                                   use(8, 1, 5, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}),
                                   use(4, 1, 5, {5, 6, 7, 8, 9, 10, 11, 30, 31, 32})};
  EXPECT_EQ(queries_to_keep(uses, {}), (std::vector<std::int64_t>{1, 2}));
}

TEST(QueryPruning, AQueryThatLostItsRivalStays) {
  // 2 overlaps 1 alone, and 1 goes because of 0.
  const std::vector<QueryUse> uses{use(9, 1, 5, {0, 1, 2, 3}),
                                   use(8, 1, 5, {1, 2, 3, 4, 5, 6}),
                                   use(7, 1, 5, {3, 4, 5, 6})};
  EXPECT_EQ(queries_to_keep(uses, {}), (std::vector<std::int64_t>{0, 2}));
}

TEST(QueryPruning, NeverRemovesAll) {
  const std::vector<QueryUse> uses{use(0, 0, 0), use(0, 0, 0)};
  EXPECT_EQ(queries_to_keep(uses, {}), (std::vector<std::int64_t>{0, 1}));
  EXPECT_TRUE(queries_to_keep({}, {}).empty());
}

class PixelSampling : public ::testing::Test {
 protected:
  PixelSampling() : masks_(masks_of(100, 100)) {
    fill(masks_, 0, 60, 1, 0);
    fill(masks_, 60, 65, 3, 2);  // The rest is void.
    config_.pixels = 1000;
  }
  std::vector<std::int32_t> draw(const core::Image<float>& depth_m = {}) {
    core::RandomStream random(1, "pixels");
    return sample_pixels(masks_, depth_m, classes_, config_, random).pixels;
  }
  core::FrameMasks masks_;
  std::vector<core::SceneClass> classes_{{1, "floor", false}, {3, "chair", true}};
  PixelSamplingConfig config_;
};

TEST_F(PixelSampling, SharesAreThoseAskedFor) {
  const std::vector<std::int32_t> pixels = draw();
  ASSERT_EQ(pixels.size(), 1000U);
  EXPECT_TRUE(std::is_sorted(pixels.begin(), pixels.end()));
  int stuff = 0, things = 0;
  for (const std::int32_t p : pixels) {
    stuff += p % 100 < 60 ? 1 : 0;
    things += p % 100 >= 60 && p % 100 < 65 ? 1 : 0;
  }
  // 500 and 200, and of 300 uniform ones 60 % and 5 %.
  EXPECT_NEAR(stuff, 500 + 180, 40);
  EXPECT_NEAR(things, 200 + 15, 15);
}

TEST_F(PixelSampling, ImportanceTakesTheSharesBackOut) {
  config_.even_share = 0.5;
  double chair = 0.0, sum = 0.0, void_sum = 0.0;
  for (std::uint64_t i = 0; i < 20; ++i) {
    core::RandomStream random(i, "pixels");
    const PixelSample sample = sample_pixels(masks_, {}, classes_, config_, random);
    ASSERT_EQ(sample.importance.size(), sample.pixels.size());
    for (std::size_t k = 0; k < sample.pixels.size(); ++k) {
      const int x = sample.pixels[k] % 100;
      sum += static_cast<double>(sample.importance[k]);
      if (x >= 60 && x < 65) chair += static_cast<double>(sample.importance[k]);
      if (x >= 65) void_sum += static_cast<double>(sample.importance[k]);
    }
  }
  EXPECT_NEAR(sum, 20'000.0, 1.0);          // Mean 1 ...
  EXPECT_NEAR(chair / sum, 0.05, 0.002);    // ... and areas as in the image, though 215 of
  EXPECT_NEAR(void_sum / sum, 0.35, 0.03);  // 1000 samples are of the chair.
}

TEST_F(PixelSampling, WhatIsMissingIsDrawnAnywhere) {
  masks_ = masks_of(100, 100);
  EXPECT_EQ(draw().size(), 1000U);
  config_.pixels = 100'000;
  EXPECT_EQ(draw().size(), 10'000U);  // All there are.
}

TEST_F(PixelSampling, NearPixelsAndPixelsWithoutDepthAreNotDrawn) {
  core::Image<float> depth_m(100, 100, std::nanf(""));
  for (int y = 0; y < 100; ++y) depth_m(7, y) = 2.0F, depth_m(8, y) = 0.2F;
  for (const std::int32_t p : draw(depth_m)) EXPECT_EQ(p % 100, 7);
  EXPECT_FALSE(draw(depth_m).empty());
}

TEST(WarpPixels, PointsLandWhereTheOtherCameraSeesThem) {
  // The other camera is 0.2 m to the right (-y): what was at the centre moves to the left.
  const core::CameraPose other = core::look_at({1.0, 1.8, 1.0}, {4.0, 1.8, 1.0});
  const core::Image<float> depth_m(40, 30, 2.0F);
  std::vector<std::int32_t> pixels;
  for (int i = 0; i < 40 * 30; ++i) pixels.push_back(i);
  const auto at = warp_pixels(pixels, depth_m, kCamera, kPose, depth_m, kCamera, other, 0.05);
  const double shift_px = kCamera.fx_px * 0.2 / 2.0;
  for (const std::int32_t p : pixels) {
    const double x = p % 40 + 0.5 - shift_px;
    const std::int32_t expected =
        x < 0.0 ? -1 : p / 40 * 40 + static_cast<std::int32_t>(std::floor(x));
    EXPECT_EQ(at[static_cast<std::size_t>(p)], expected) << p;
  }
}

TEST(WarpPixels, WhatIsHiddenOrUnknownThereIsNotFound) {
  const core::Image<float> depth_m(40, 30, 2.0F), nearer(40, 30, 1.9F), close(40, 30, 1.97F);
  const std::vector<std::int32_t> pixels{610};
  const auto warp = [&](const core::Image<float>& here, const core::Image<float>& there) {
    return warp_pixels(pixels, here, kCamera, kPose, there, kCamera, kPose, 0.05)[0];
  };
  EXPECT_EQ(warp(depth_m, depth_m), 610);
  EXPECT_EQ(warp(depth_m, close), 610);
  EXPECT_EQ(warp(depth_m, nearer), -1);
  EXPECT_EQ(warp(depth_m, core::Image<float>(40, 30, std::nanf(""))), -1);
  EXPECT_EQ(warp(core::Image<float>(40, 30, std::nanf("")), depth_m), -1);
}

}  // namespace
}  // namespace segsim::reconstruction
