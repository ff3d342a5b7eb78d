// Floor, walls and ceiling by shape, and objects in boxes, on scenes with a known answer.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "reconstruction/segmentation/box_segmenter.h"
#include "reconstruction/segmentation/room_parts.h"

namespace segsim::reconstruction {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

/// Patches on a 10 cm grid of the rectangle origin + s u + t v, s in [0, a), t in [0, b).
void add_patches(std::vector<SurfaceElement>& to, const glm::dvec3& origin_m,
                 const glm::dvec3& u, double a_m, const glm::dvec3& v, double b_m,
                 const glm::dvec3& normal) {
  for (double s = 0.05; s < a_m; s += 0.1) {
    for (double t = 0.05; t < b_m; t += 0.1) {
      to.push_back({origin_m + s * u + t * v, normal});
    }
  }
}

const glm::dvec3 kX(1, 0, 0), kY(0, 1, 0), kZ(0, 0, 1);

TEST(RoomParts, FurnitureIsNoWallAndATableNoFloor) {
  std::vector<SurfaceElement> patches;
  add_patches(patches, {0, 0, 0}, kX, 4, kY, 3, kZ);           // Floor.
  add_patches(patches, {0, 0, 2.5}, kX, 4, kY, 3, -kZ);        // Ceiling.
  add_patches(patches, {0, 3, 0}, kX, 4, kZ, 2.5, -kY);        // Wall.
  add_patches(patches, {1, 2.4, 0}, kX, 1.2, kZ, 2.0, -kY);    // Front of a wardrobe.
  add_patches(patches, {1, 1, 0.75}, kX, 1.2, kY, 0.8, kZ);    // Table.
  add_patches(patches, {3.5, 1, 2.2}, kX, 0.2, kZ, 0.2, -kY);  // Something small and high.
  const RoomParts room(patches);
  const auto at = [&](const glm::dvec3& p, const glm::dvec3& n) {
    return room.at(p, glm::vec3(n), 0.05);
  };
  EXPECT_EQ(at({2, 1.5, 0.01}, kZ), RoomPart::kFloor);
  EXPECT_EQ(at({2, 1.5, 2.49}, -kZ), RoomPart::kCeiling);
  EXPECT_EQ(at({2, 2.99, 0.4}, -kY), RoomPart::kWall);
  EXPECT_EQ(at({1.5, 2.4, 1.0}, -kY), RoomPart::kNone);
  EXPECT_EQ(at({1.5, 1.4, 0.75}, kZ), RoomPart::kNone);
  EXPECT_EQ(at({3.6, 1.0, 2.3}, -kY), RoomPart::kNone);
  // On the plane, but off it by more than the distance or facing another way.
  EXPECT_EQ(at({2, 2.9, 0.4}, -kY), RoomPart::kNone);
  EXPECT_EQ(at({2, 2.99, 0.4}, kX), RoomPart::kNone);
  EXPECT_EQ(at({2, 2.99, 0.4}, glm::dvec3(0)), RoomPart::kWall);  // Unknown normal.
}

TEST(RoomParts, AThinWallHasTwoSides) {
  const auto camera = core::CameraIntrinsics::from_fov(160, 120, 1.6);
  const core::Image<float> depth_m(160, 120, 2.0F);  // A plane across the view, 2 m away.
  FacingPoints points;
  // The wall is at x = 2 from one side and at x = 2.06 from the other.
  const auto here = core::look_at({0, 0, 1.5}, {2, 0, 1.5});
  const auto there = core::look_at({4.06, 0, 1.5}, {2, 0, 1.5});
  points.add_view(depth_m, camera, here, 2);
  points.add_view(depth_m, camera, there, 2);
  const RoomParts room(points.elements());
  const auto share = [&](const core::CameraPose& pose) {
    const auto parts = room.of_view(depth_m, camera, pose);
    return static_cast<double>(
               std::count(parts.pixels().begin(), parts.pixels().end(), RoomPart::kWall)) /
           static_cast<double>(parts.size());
  };
  EXPECT_GT(share(here), 0.9);
  EXPECT_GT(share(there), 0.9);
}

struct View {
  core::Image<core::Rgb8> rgb{120, 90, {120, 110, 100}};
  core::Image<float> depth_m{120, 90, 3.0F};
  core::Image<RoomPart> parts;

  void paint(int x0, int y0, int x1, int y1, core::Rgb8 colour, float d_m) {
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) rgb(x, y) = colour, depth_m(x, y) = d_m;
    }
  }
  [[nodiscard]] BoxSegmenter segmenter() const { return {rgb, depth_m, parts, 100.0}; }
};

double iou(const core::Image<std::uint8_t>& mask, int x0, int y0, int x1, int y1) {
  int common = 0, either = 0;
  for (int y = 0; y < mask.height_px(); ++y) {
    for (int x = 0; x < mask.width_px(); ++x) {
      const bool truth = x >= x0 && x < x1 && y >= y0 && y < y1;
      common += truth && mask(x, y) != 0 ? 1 : 0;
      either += truth || mask(x, y) != 0 ? 1 : 0;
    }
  }
  return static_cast<double>(common) / either;
}

TEST(BoxSegmenter, DepthFindsWhatHasTheColourOfItsSurroundings) {
  View view;
  view.paint(40, 30, 80, 70, {120, 110, 100}, 2.0F);
  const auto mask = view.segmenter().segment({36, 26, 84, 74});  // A loose box.
  // But for the pixel at the step, which colour decides: the cameras' edges differ.
  EXPECT_GE(iou(mask, 40, 30, 80, 70), 38.0 * 38.0 / (40.0 * 40.0));
}

TEST(BoxSegmenter, ColourFindsWhatHasNoDepth) {
  View view;
  view.paint(40, 30, 80, 70, {20, 20, 25}, kNone);
  const auto mask = view.segmenter().segment({37, 27, 83, 73});
  EXPECT_GT(iou(mask, 40, 30, 80, 70), 0.9);
}

TEST(BoxSegmenter, WhatLiesMostlyOutsideTheBoxIsSomethingElses) {
  View view;
  view.paint(40, 20, 80, 60, {200, 60, 40}, 2.2F);
  view.paint(0, 55, 120, 75, {200, 60, 40}, 1.9F);  // A table across the view, before it.
  const auto mask = view.segmenter().segment({39, 19, 81, 61});
  EXPECT_GT(iou(mask, 40, 20, 80, 55), 0.93);
}

TEST(BoxSegmenter, FloorAndWallsAreNoObjects) {
  View view;
  view.paint(40, 30, 80, 70, {200, 60, 40}, 2.95F);  // No depth step to the surroundings.
  view.parts = core::Image<RoomPart>(120, 90, RoomPart::kWall);
  for (int y = 30; y < 70; ++y) {
    for (int x = 40; x < 80; ++x) view.parts(x, y) = RoomPart::kNone;
  }
  EXPECT_EQ(iou(view.segmenter().segment({34, 24, 86, 76}), 40, 30, 80, 70), 1.0);
}

TEST(BoxSegmenter, NarrowHolesDoNotPartASurface) {
  View view;
  view.paint(40, 30, 80, 70, {90, 90, 90}, 2.0F);
  view.paint(59, 30, 61, 70, {90, 90, 90}, kNone);
  const BoxSegmenter segmenter = view.segmenter();
  EXPECT_EQ(segmenter.regions()(45, 50), segmenter.regions()(75, 50));
  EXPECT_NE(segmenter.regions()(45, 50), segmenter.regions()(10, 50));
}

TEST(BoxSegmenter, AskingForOtherBoxesChangesNothing) {
  View view;
  for (int y = 0; y < 90; ++y) {  // Speckles, so that colours are hard to tell apart.
    for (int x = 0; x < 120; ++x) {
      const int v = (x * 7919 + y * 104729) % 97;
      view.rgb(x, y) = {static_cast<std::uint8_t>(80 + v), static_cast<std::uint8_t>(60 + v),
                        static_cast<std::uint8_t>(90 + v / 2)};
      if ((x - 60) * (x - 60) + (y - 45) * (y - 45) < 500) view.depth_m(x, y) = kNone;
    }
  }
  const BoxSegmenter segmenter = view.segmenter();
  const auto first = segmenter.segment({35, 20, 85, 70});
  (void)segmenter.segment({5, 5, 50, 50});
  EXPECT_EQ(first.pixels(), segmenter.segment({35, 20, 85, 70}).pixels());
}

TEST(BoxSegmenter, BoxesOffTheImageAreNothing) {
  const View view;
  for (const core::BoxPx& box :
       {core::BoxPx{-50, -50, -10, -10}, core::BoxPx{200, 10, 240, 50}, {5, 5, 6, 6}}) {
    const auto mask = view.segmenter().segment(box);
    EXPECT_EQ(std::count(mask.pixels().begin(), mask.pixels().end(), 1), 0);
  }
}

}  // namespace
}  // namespace segsim::reconstruction
