#include "reconstruction/labels/guidance_graph.h"

#include <set>
#include <vector>

#include <gtest/gtest.h>

namespace segsim::reconstruction {
namespace {

constexpr int kSize = 40;  ///< Of the image; each pixel shows one surfel.
constexpr float kSpacing_m = 0.05F;
constexpr std::uint16_t kFloor = 1, kChair = 3, kTable = 4;

/// A floor of 2 m, folded up to a wall beyond row 30. Pixel i shows surfel i.
class GuidanceGraphTest : public ::testing::Test {
 protected:
  GuidanceGraphTest() {
    for (int y = 0; y < kSize; ++y) {
      for (int x = 0; x < kSize; ++x) {
        const bool wall = y >= 30;
        position_m_.emplace_back(kSpacing_m * static_cast<float>(x),
                                 kSpacing_m * static_cast<float>(wall ? 30 : y),
                                 kSpacing_m * static_cast<float>(wall ? y - 30 : 0));
        // Either side is the same.
        normal_.push_back((wall ? glm::vec3(0, 1, 0) : glm::vec3(0, 0, 1)) *
                          (x % 2 == 0 ? 1.0F : -1.0F));
        pixels_.push_back(y * kSize + x);
        surfel_.push_back(y * kSize + x);
      }
    }
    config_.min_surfels = 5;
    config_.max_radius_m = 0.21;
  }

  /// Two chairs side by side, and a table; ids are shuffled.
  [[nodiscard]] static core::FrameMasks masks(int view) {
    core::FrameMasks masks;
    masks.semantic = core::Image<std::uint16_t>(kSize, kSize, kFloor);
    masks.instance = core::Image<std::uint16_t>(kSize, kSize, 0);
    const auto paint = [&](int x0, int x1, int y0, int y1, std::uint16_t class_id,
                           int object) {
      for (int y = y0; y < y1; ++y) {
        for (int x = x0; x < x1; ++x) {
          masks.semantic(x, y) = class_id;
          masks.instance(x, y) = static_cast<std::uint16_t>(1 + (object + view) % 3);
        }
      }
    };
    paint(0, 12, 0, 12, kChair, 0);
    paint(12, 24, 0, 12, kChair, 1);
    paint(25, 40, 15, 40, kTable, 2);
    return masks;
  }
  [[nodiscard]] GuidanceGraph graph() const { return {position_m_, normal_, config_}; }

  std::vector<glm::vec3> position_m_, normal_;
  std::vector<std::int32_t> pixels_;
  std::vector<std::int64_t> surfel_;
  PanopticReconConfig config_;
};

TEST_F(GuidanceGraphTest, PatchesAreSmallAndFaceOneWay) {
  const GuidanceGraph g = graph();
  EXPECT_GT(g.patches(), 30);
  std::vector<std::set<bool>> on_wall(static_cast<std::size_t>(g.patches()));
  std::vector<int> surfels(on_wall.size(), 0);
  for (std::size_t s = 0; s < position_m_.size(); ++s) {
    const std::int32_t patch = g.patch_of()[s];
    if (patch < 0) continue;
    on_wall[static_cast<std::size_t>(patch)].insert(s >= 30 * kSize);
    ++surfels[static_cast<std::size_t>(patch)];
  }
  for (std::size_t p = 0; p < on_wall.size(); ++p) {
    EXPECT_EQ(on_wall[p].size(), 1U) << p;
    EXPECT_GE(surfels[p], 5) << p;
    EXPECT_LE(surfels[p], 9 * 9) << p;
  }
}

TEST_F(GuidanceGraphTest, MasksOfAllViewsBecomeObjects) {
  GuidanceGraph g = graph();
  for (int view = 0; view < 4; ++view) g.add_view(masks(view), pixels_, surfel_);
  const GuidedObjects found = g.objects();
  ASSERT_EQ(found.class_id, (std::vector<std::uint16_t>{kTable, kChair, kChair}));
  for (int view = 0; view < 4; ++view) {
    const auto& object_of = found.object_of_mask[static_cast<std::size_t>(view)];
    ASSERT_EQ(object_of.size(), 3U);
    EXPECT_EQ(object_of.at(static_cast<std::uint16_t>(1 + (2 + view) % 3)), 1);
    const int chair = found.object_of_mask[0].at(1);
    EXPECT_EQ(object_of.at(static_cast<std::uint16_t>(1 + view % 3)), chair);
  }
}

TEST_F(GuidanceGraphTest, OneViewOfMergedChairsIsOutvoted) {
  GuidanceGraph g = graph();
  for (int view = 0; view < 5; ++view) {
    core::FrameMasks m = masks(view);
    if (view == 2) {
      const std::uint16_t left = m.instance(0, 0), right = m.instance(20, 0);
      for (auto& id : m.instance.pixels()) id = id == right ? left : id;
    }
    g.add_view(m, pixels_, surfel_);
  }
  EXPECT_EQ(g.objects().class_id.size(), 3U);
}

TEST_F(GuidanceGraphTest, ClassesAreThoseOfMostMasks) {
  GuidanceGraph g = graph();
  for (int view = 0; view < 5; ++view) {
    core::FrameMasks m = masks(view);
    if (view < 2) {
      for (auto& c : m.semantic.pixels()) c = c == kTable ? kChair : c;
    }
    g.add_view(m, pixels_, surfel_);
  }
  EXPECT_EQ(g.objects().class_id, (std::vector<std::uint16_t>{kTable, kChair, kChair}));
}

TEST_F(GuidanceGraphTest, WhatFewViewsShowIsNoObject) {
  GuidanceGraph g = graph();
  for (int view = 0; view < 2; ++view) g.add_view(masks(view), pixels_, surfel_);
  EXPECT_TRUE(g.objects().class_id.empty());  // min_views = 3.
  EXPECT_TRUE(g.objects().object_of_mask[0].empty());
}

}  // namespace
}  // namespace segsim::reconstruction
