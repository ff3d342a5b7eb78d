#include "reconstruction/labels/mask_association.h"

#include <cmath>
#include <functional>

#include <gmock/gmock.h>

#include "core/random.h"

namespace segsim::reconstruction {
namespace {

constexpr int kSize = 96;
constexpr std::uint16_t kWall = 1, kChair = 3, kTable = 4;
const core::CameraIntrinsics kCamera{.width_px = kSize,
                                     .height_px = kSize,
                                     .fx_px = 48.0,
                                     .fy_px = 48.0,
                                     .cx_px = 48.0,
                                     .cy_px = 48.0};

/// A wall at x = 2 m with objects painted on it, seen from cameras that move along y.
struct Painted {
  double y_m, z_m, half_m;
  std::uint16_t class_id;
};
const std::vector<Painted> kObjects{{-0.9, 1.0, 0.25, kChair},
                                    {-0.3, 1.0, 0.25, kChair},
                                    {0.4, 1.2, 0.3, kTable},
                                    {1.2, 0.8, 0.2, kChair}};

struct View {
  core::FrameMasks masks;
  core::Image<float> depth_m{kSize, kSize, 2.0F};
  core::CameraPose pose;
};

/// Ids are shuffled: object o has id 1 + (o + view) mod 4.
View view_of(int view) {
  View v;
  v.masks.semantic = core::Image<std::uint16_t>(kSize, kSize, kWall);
  v.masks.instance = core::Image<std::uint16_t>(kSize, kSize, 0);
  const double y_m = 0.1 * (view % 11 - 5);
  v.pose = core::look_at({0.0, y_m, 1.0}, {2.0, y_m, 1.0});
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const glm::dvec3 p_m =
          v.pose.rotation() * kCamera.back_project({x + 0.5, y + 0.5}, 2.0) +
          v.pose.translation_m();
      for (std::size_t o = 0; o < kObjects.size(); ++o) {
        if (std::abs(p_m.y - kObjects[o].y_m) > kObjects[o].half_m ||
            std::abs(p_m.z - kObjects[o].z_m) > kObjects[o].half_m) {
          continue;
        }
        v.masks.semantic(x, y) = kObjects[o].class_id;
        v.masks.instance(x, y) =
            static_cast<std::uint16_t>(1 + (o + static_cast<std::size_t>(view)) % 4);
      }
    }
  }
  return v;
}

/// Objects of 22 views, each changed by `change`.
std::vector<AssociatedObject> objects_of(const std::function<void(int, View&)>& change =
                                             [](int, View&) {}) {
  MaskAssociation association({});
  for (int i = 0; i < 22; ++i) {
    View v = view_of(i);
    change(i, v);
    association.add_view(v.masks, v.depth_m, kCamera, v.pose);
  }
  return association.objects();
}

/// Every painted object is there once, where it is, as large as it is.
void expect_all(const std::vector<AssociatedObject>& found, double tolerance_m) {
  ASSERT_EQ(found.size(), kObjects.size());
  for (const Painted& object : kObjects) {
    int hits = 0;
    for (const AssociatedObject& f : found) {
      if (std::abs(static_cast<double>(f.mean_m.y) - object.y_m) > tolerance_m ||
          std::abs(static_cast<double>(f.mean_m.z) - object.z_m) > tolerance_m) {
        continue;
      }
      ++hits;
      EXPECT_EQ(f.class_id, object.class_id);
      EXPECT_NEAR(f.mean_m.x, 2.0, 1e-6);
      // Of a uniform square: half / sqrt(3).
      EXPECT_NEAR(f.sigma_m.y, object.half_m / std::sqrt(3.0), tolerance_m);
      EXPECT_LT(f.sigma_m.x, 1e-3F);
    }
    EXPECT_EQ(hits, 1) << object.y_m;
  }
}

/// Calls with every pixel of an object in a view.
void paint(View& v, std::uint16_t id, const std::function<void(int, int)>& pixel) {
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      if (v.masks.instance(x, y) == id) pixel(x, y);
    }
  }
}

TEST(MaskAssociation, ShuffledIdsBecomeObjects) { expect_all(objects_of(), 0.04); }

TEST(MaskAssociation, MasksThatAreMissingOrVoidDoNotSplitObjects) {
  const auto found = objects_of([](int i, View& v) {
    if (i % 3 != 0) return;
    paint(v, static_cast<std::uint16_t>(1 + i % 4), [&](int x, int y) {
      v.masks.semantic(x, y) = 0;
      v.masks.instance(x, y) = 0;
    });
  });
  expect_all(found, 0.06);
}

TEST(MaskAssociation, NeighboursThatAreSometimesOneMaskStayTwo) {
  const auto found = objects_of([](int i, View& v) {
    if (i % 5 != 4) return;  // Objects 0 and 1 in one mask.
    const auto one = static_cast<std::uint16_t>(1 + i % 4);
    paint(v, static_cast<std::uint16_t>(1 + (i + 1) % 4),
          [&](int x, int y) { v.masks.instance(x, y) = one; });
  });
  expect_all(found, 0.06);
}

TEST(MaskAssociation, DoubledPartsAndStrayMasksLoseTheVote) {
  const auto found = objects_of([](int i, View& v) {
    core::RandomStream random(7, "parts", static_cast<std::uint64_t>(i));
    // A third of the table has an id of its own half of the time, ...
    const int cut = static_cast<int>(random.index(3));
    if (i % 2 == 0) {
      paint(v, static_cast<std::uint16_t>(1 + (i + 2) % 4), [&](int x, int y) {
        if (y % 15 / 5 == cut) v.masks.instance(x, y) = 9;
      });
    }
    // ... and a mask lies anywhere on the wall.
    const int left = static_cast<int>(random.index(80)),
              top = static_cast<int>(random.index(80));
    for (int y = top; y < top + 12; ++y) {
      for (int x = left; x < left + 12; ++x) {
        v.masks.instance(x, y) = 10;
        v.masks.semantic(x, y) = kTable;
      }
    }
  });
  expect_all(found, 0.08);
}

TEST(MaskAssociation, EveryMaskIsNamedByTheObjectThatItLiesOn) {
  const auto found = objects_of([](int i, View& v) {
    // In one view half of the table has an id of its own, which no other view confirms.
    if (i != 8) return;
    paint(v, static_cast<std::uint16_t>(1 + (i + 2) % 4), [&](int x, int y) {
      if (y < kSize / 2) v.masks.instance(x, y) = 9;
    });
  });
  ASSERT_EQ(found.size(), kObjects.size());
  for (const AssociatedObject& object : found) {
    std::size_t o = 0;
    while (std::abs(static_cast<double>(object.mean_m.y) - kObjects[o].y_m) > 0.1) ++o;
    std::vector<MaskOfView> expected;
    for (int view = 0; view < 22; ++view) {
      expected.push_back(
          {view, static_cast<std::uint16_t>(1 + (o + static_cast<std::size_t>(view)) % 4)});
      if (view == 8 && o == 2) expected.push_back({view, 9});
    }
    EXPECT_THAT(object.masks, ::testing::UnorderedElementsAreArray(expected)) << o;
  }
}

TEST(MaskAssociation, WhatFewViewsShowIsNoObject) {
  MaskAssociation association({});
  EXPECT_TRUE(association.objects().empty());
  for (int i = 0; i < 2; ++i) {
    const View v = view_of(i);
    association.add_view(v.masks, v.depth_m, kCamera, v.pose);
  }
  EXPECT_TRUE(association.objects().empty());  // min_views = 3.
}

TEST(MaskAssociation, PixelsWithoutDepthAreNotThere) {
  const auto none = objects_of([](int, View& v) {
    for (std::size_t i = 0; i < v.depth_m.size(); ++i) {
      v.depth_m.data()[i] = i % 2 == 0 ? std::nanf("") : 0.1F;
    }
  });
  EXPECT_TRUE(none.empty());
}

}  // namespace
}  // namespace segsim::reconstruction
