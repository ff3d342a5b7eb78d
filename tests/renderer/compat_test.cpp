// The rules of the two 2DGS programs: worked numbers, and a second implementation in the
// programs' own coordinates.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include <glm/geometric.hpp>

#include "core/frames.h"
#include "renderer/raster/compat_rules.h"
#include "renderer/reference_renderer.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer {
namespace {

using core::CameraIntrinsics;
using core::CameraPose;
using core::Channels;
using core::Frame;
using internal::TileRectangle;
using testing::add;
using testing::Surfel;

constexpr Compat kPrograms[] = {Compat::kInria, Compat::kGsplat};

Frame render(const SurfelCloud& cloud, Compat compat, const CameraIntrinsics& intrinsics,
             const CameraPose& pose = CameraPose(), DepthMode depth = DepthMode::kMedian) {
  const RenderOptions options{.compat = compat, .depth = depth};
  return make_reference_renderer(std::make_shared<const SurfelCloud>(cloud), options)
      ->render(pose, intrinsics, Channels::kAll);
}

SurfelCloud one(const Surfel& s) {
  SurfelCloud cloud;
  add(cloud, s);
  return cloud;
}

TEST(CompatTiles, SquareIsCountedFromTheFirstPixelsCentre) {
  // c = x - 0.5 is the 2DGS code's coordinate; tiles trunc(c_min / 16) ... trunc((c_max + 15)
  // / 16) - 1.
  const auto columns = [](double c_min, double c_max) {
    const TileRectangle t =
        internal::tiles_of_square({c_min + 0.5, c_max + 0.5, 0.5, 1.5}, 10, 10);
    return std::pair(t.x_begin, t.x_end);
  };
  EXPECT_EQ(columns(16.0, 31.0), std::pair(1, 2));
  EXPECT_EQ(columns(15.9, 32.9), std::pair(0, 2));  // Pixel 32 is in reach, its tile is not.
  EXPECT_EQ(columns(15.9, 33.0), std::pair(0, 3));
  EXPECT_EQ(columns(-40.0, 5.0), std::pair(0, 1));
  EXPECT_EQ(columns(100.0, 1e30), std::pair(6, 10));
  EXPECT_TRUE(internal::tiles_of_square({-50.0, -20.0, 0.0, 9.0}, 10, 10).empty());
  EXPECT_TRUE(internal::tiles_of_square({170.0, 190.0, 0.0, 9.0}, 10, 10).empty());
}

TEST(CompatTiles, GsplatBoxIsCountedFromTheEdge) {
  const auto columns = [](double x_min, double x_max) {
    const TileRectangle t = internal::tiles_of_gsplat_box({x_min, x_max, 0.0, 1.0}, 10, 10);
    return std::pair(t.x_begin, t.x_end);
  };
  EXPECT_EQ(columns(16.0, 32.0), std::pair(1, 2));
  EXPECT_EQ(columns(15.9, 32.1), std::pair(0, 3));
  EXPECT_EQ(columns(-3.0, 2.0), std::pair(0, 1));
}

TEST(CompatTiles, NotANumberIsNoTile) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(internal::tiles_of_square({kNan, kNan, kNan, kNan}, 10, 10).empty());
  EXPECT_TRUE(internal::tiles_of_gsplat_box({kNan, kNan, kNan, kNan}, 10, 10).empty());
}

TEST(CompatTiles, BoxesOfAnUprightDisc) {
  // 4.5 x 2 px per sigma. Inria: ceil(3 * 4.5) = 14 both ways. Gsplat: ceil(3.33 * 4.5 =
  // 14.985) = 15 and ceil(6.66) = 7.
  const ConicBox<double> at_3{100.0, 100.0, 13.5, 6.0, true};
  const ConicBox<double> at_1{100.0, 100.0, 4.5, 2.0, true};
  const TileRectangle inria = internal::compat_tiles(Compat::kInria, at_3, 20, 20);
  EXPECT_EQ(inria.x_begin, 5);  // 99.5 - 14 = 85.5
  EXPECT_EQ(inria.x_end, 8);    // 99.5 + 14 + 15 = 128.5
  EXPECT_EQ(inria.y_begin, 5);
  EXPECT_EQ(inria.y_end, 8);
  const TileRectangle gsplat = internal::compat_tiles(Compat::kGsplat, at_1, 20, 20);
  EXPECT_EQ(gsplat.x_begin, 5);  // 85
  EXPECT_EQ(gsplat.x_end, 8);    // 115
  EXPECT_EQ(gsplat.y_begin, 5);  // 93
  EXPECT_EQ(gsplat.y_end, 7);    // 107
}

TEST(CompatTiles, SubPixelSurfelKeepsTheLowPassOfInriaOnly) {
  // Half extents of 0.01 px: ceil(3 * 0.707106) = 3 px; gsplat ceil(3.33 * 0.01) = 1 px.
  const ConicBox<double> tiny{33.0, 33.0, 0.01, 0.01, true};
  const TileRectangle inria = internal::compat_tiles(Compat::kInria, tiny, 9, 9);
  EXPECT_EQ(inria.x_begin, 1);  // 32.5 - 3
  const TileRectangle gsplat = internal::compat_tiles(Compat::kGsplat, tiny, 9, 9);
  EXPECT_EQ(gsplat.x_begin, 2);  // 33 - 1
  EXPECT_TRUE(internal::compat_tiles(Compat::kInria, {33, 33, 1, 1, false}, 9, 9).empty());
}

TEST(CompatImage, BoundsClipAtTiles) {
  // 4.5 px per sigma at column 34.5 (c = 34). Inria's square ends at c = 48 < 49: tile 3 is
  // not listed. Gsplat's box ends at 49.5 and lists it.
  Surfel s;
  s.position_m = {0.0F, 0.0F, 2.0F};
  s.scale_m = {0.09F, 0.09F};
  s.opacity = 1.0F;
  const CameraIntrinsics camera{80, 40, 100.0, 100.0, 34.5, 20.5};
  const Frame exact = render(one(s), Compat::kExact, camera);
  const Frame inria = render(one(s), Compat::kInria, camera);
  const Frame gsplat = render(one(s), Compat::kGsplat, camera);
  const double tail = std::exp(-0.5 * std::pow(14.0 / 4.5, 2));  // 0.0079
  EXPECT_NEAR(exact.alpha(48, 20), tail, 1e-6);
  EXPECT_NEAR(gsplat.alpha(48, 20), tail, 1e-6);
  EXPECT_EQ(inria.alpha(48, 20), 0.0F);
  EXPECT_NEAR(inria.alpha(47, 20), exact.alpha(47, 20), 1e-6F);
  EXPECT_EQ(inria.stats.pairs_binned, 2U * 3U);
  EXPECT_EQ(gsplat.stats.pairs_binned, 3U * 3U);
}

TEST(CompatImage, CentresNearAndFarAreDropped) {
  const CameraIntrinsics camera{33, 33, 50.0, 50.0, 16.5, 16.5};
  const auto drawn = [&](float z_m, Compat compat) {
    Surfel s;
    s.position_m = {0.0F, 0.0F, z_m};
    s.scale_m = glm::vec2(0.1F * z_m);
    return render(one(s), compat, camera).alpha(16, 16) > 0.0F;
  };
  EXPECT_TRUE(drawn(0.15F, Compat::kExact));
  for (const Compat compat : kPrograms) {
    EXPECT_FALSE(drawn(0.15F, compat));
    EXPECT_FALSE(drawn(0.2F, compat));
    EXPECT_TRUE(drawn(0.2001F, compat));
  }
  EXPECT_TRUE(drawn(250.0F, Compat::kInria));
  EXPECT_FALSE(drawn(250.0F, Compat::kGsplat));
}

/// A floor of one disc 0.3 m below the eye, from behind it to 2.6 m before it.
Surfel floor_disc() {
  Surfel s;
  s.position_m = {0.0F, 0.3F, 1.0F};
  // Cyclic: t_u = y, t_v = z, n = x, turned about z so that n = y.
  s.R_world_surfel = testing::facing({0.0F, -1.0F, 0.0F});
  s.scale_m = {0.5F, 0.5F};
  s.opacity = 0.9F;
  return s;
}

/// rho of that disc where the ray of pixel (x, y) meets its plane, at either side of the eye.
double floor_rho(const CameraIntrinsics& c, int x, int y, double& depth_m) {
  const double dx = (x + 0.5 - c.cx_px) / c.fx_px, dy = (y + 0.5 - c.cy_px) / c.fy_px;
  depth_m = 0.3 / dy;
  const double u = dx * depth_m / 0.5, v = (depth_m - 1.0) / 0.5;
  return u * u + v * v;
}

TEST(CompatImage, GsplatDrawsGhostsFromBehind) {
  const CameraIntrinsics camera{32, 32, 20.0, 20.0, 16.0, 16.0};
  // Row 4 looks up: it meets the floor 0.52 m behind the eye, 3.04 sigma from the centre. The
  // 1-sigma conic lies at [0.2, 0.6] fy below the horizon; 3.33 times that reaches row 10, so
  // the tile is listed.
  double depth_m = 0.0;
  const double rho = floor_rho(camera, 16, 4, depth_m);
  ASSERT_NEAR(depth_m, -0.5217, 1e-4);
  ASSERT_LT(rho, extent_squared(0.9));
  EXPECT_NEAR(render(one(floor_disc()), Compat::kGsplat, camera).alpha(16, 4),
              0.9 * std::exp(-0.5 * rho), 1e-6);
  EXPECT_EQ(render(one(floor_disc()), Compat::kInria, camera).alpha(16, 4), 0.0F);
  EXPECT_EQ(render(one(floor_disc()), Compat::kExact, camera).alpha(16, 4), 0.0F);
}

TEST(CompatImage, InriasSquareOfAHyperbolaIsTooSmall) {
  // k = 3: D = 1 - 9 / 4 < 0. By the formulas: centre (0.3 - 0.54) fy below the principal
  // point, half height 0.36 fy = 7.2 px: rows of c = 10.7 +- 8, tiles 0 and 1. The floor goes
  // on below.
  const CameraIntrinsics camera{32, 64, 20.0, 20.0, 16.0, 16.0};
  const Frame exact = render(one(floor_disc()), Compat::kExact, camera);
  const Frame inria = render(one(floor_disc()), Compat::kInria, camera);
  EXPECT_GT(exact.alpha(16, 32), 0.2F);
  EXPECT_EQ(inria.alpha(16, 32), 0.0F);
  EXPECT_NEAR(inria.alpha(16, 31), exact.alpha(16, 31), 1e-6F);
}

TEST(CompatImage, InriaDropsFragmentsBeforeItsNearPlane) {
  // 0.28 m per sigma: from 0.068 m on, and the 3-sigma conic is an ellipse. fy = 8: row 29
  // meets the floor at 2.4 / 13.5 = 0.178 m, row 27 at 0.209 m.
  Surfel s = floor_disc();
  s.scale_m = {0.28F, 0.28F};
  const CameraIntrinsics camera{32, 32, 8.0, 8.0, 16.0, 16.0};
  const Frame exact = render(one(s), Compat::kExact, camera);
  const Frame inria = render(one(s), Compat::kInria, camera);
  const Frame gsplat = render(one(s), Compat::kGsplat, camera);
  const auto alpha_at = [](double depth_m, double x_m) {
    const double u = x_m / 0.28, v = (depth_m - 1.0) / 0.28;
    return 0.9 * std::exp(-0.5 * (u * u + v * v));
  };
  const double at_29 = alpha_at(2.4 / 13.5, 0.5 / 8.0 * 2.4 / 13.5);
  EXPECT_NEAR(exact.alpha(16, 29), at_29, 1e-6);
  EXPECT_NEAR(gsplat.alpha(16, 29), at_29, 1e-6);
  EXPECT_EQ(inria.alpha(16, 29), 0.0F);
  EXPECT_NEAR(inria.alpha(16, 27), alpha_at(2.4 / 11.5, 0.5 / 8.0 * 2.4 / 11.5), 1e-6);
}

TEST(CompatImage, EdgeOnDiscIsALowPassDotOfGsplatOnly) {
  // t_u = y, t_v = z, n = x, and the eye in the plane x = 0. w = (0, 0.25), D = 1 - 1/16; the
  // 1-sigma conic's centre is fy * 0.15 / 16 / D = 1 px below the projected centre.
  Surfel s;
  s.position_m = {0.0F, 0.3F, 2.0F};
  s.R_world_surfel = {0.5F, 0.5F, 0.5F, 0.5F};
  s.scale_m = {0.5F, 0.5F};
  s.opacity = 0.9F;
  CameraIntrinsics camera{33, 64, 100.0, 100.0, 16.25, 16.5};
  const Frame gsplat = render(one(s), Compat::kGsplat, camera);
  // Pixel (16, 32) lies 0.25 px beside the line, on the low pass's row.
  EXPECT_NEAR(gsplat.alpha(16, 32), 0.9 * std::exp(-0.0625), 1e-6);
  EXPECT_NEAR(gsplat.alpha(16, 31), 0.9 * std::exp(-1.0625), 1e-6);
  const Frame exact = render(one(s), Compat::kExact, camera);
  EXPECT_NEAR(exact.alpha(16, 31), 0.9 * std::exp(-0.0625), 1e-6);
  const Frame inria = render(one(s), Compat::kInria, camera);
  EXPECT_EQ(inria.stats.surfels_projected, 0U);
  // A pixel whose ray lies in the plane is skipped.
  camera.cx_px = 16.5;
  EXPECT_EQ(render(one(s), Compat::kGsplat, camera).alpha(16, 32), 0.0F);
}

TEST(CompatImage, DepthOfPlaneOrOfCentre) {
  // The plane through (0, 0, 2) with normal (0.6, 0, -0.8): z = 2 / (1 - 0.75 x / z).
  Surfel s;
  s.position_m = {0.0F, 0.0F, 2.0F};
  s.R_world_surfel = testing::facing({0.6F, 0.0F, -0.8F});
  s.scale_m = {0.5F, 0.5F};
  s.opacity = 0.95F;
  const CameraIntrinsics camera{33, 33, 50.0, 50.0, 16.5, 16.5};
  for (const DepthMode mode : {DepthMode::kMedian, DepthMode::kExpected}) {
    const auto depth = [&](Compat compat) {
      return render(one(s), compat, camera, CameraPose(), mode).depth_m(21, 16);
    };
    EXPECT_NEAR(depth(Compat::kInria), 2.0 / (1.0 - 0.75 * 0.1), 1e-5);
    EXPECT_NEAR(depth(Compat::kGsplat), 2.0, 1e-6);
  }
}

TEST(CompatRules, SecondOpaqueSurfelIsNotBlended) {
  // (1 - 0.99F)^2 is just under 1e-4.
  SurfelCloud cloud;
  for (int i = 0; i < 2; ++i) {
    Surfel s;
    s.position_m = {0.0F, 0.0F, 1.0F + static_cast<float>(i)};
    s.opacity = 1.0F;
    add(cloud, s);
  }
  const CameraIntrinsics camera{33, 33, 50.0, 50.0, 16.5, 16.5};
  for (const Compat compat : kPrograms) {
    EXPECT_NEAR(render(cloud, compat, camera).alpha(16, 16), 0.99F, 1e-7F);
  }
  EXPECT_NEAR(render(cloud, Compat::kExact, camera).alpha(16, 16), 0.9999F, 1e-6F);
}

TEST(CompatRules, TheyDifferAtEqualityOnly) {
  const auto inria = internal::rules_of(Compat::kInria);
  const auto gsplat = internal::rules_of(Compat::kGsplat);
  EXPECT_FALSE(internal::finishes(inria, 1e-4));
  EXPECT_TRUE(internal::finishes(gsplat, 1e-4));
  for (const auto& rules : {inria, gsplat}) {
    EXPECT_TRUE(internal::finishes(rules, 0.99999e-4));
    EXPECT_FALSE(internal::finishes(rules, 1.00001e-4));
  }
}

/// A surfel as the 2DGS code keeps it: three rows of T with pixel centres at integers.
struct Splat {
  glm::dvec3 Tu, Tv, Tw;
  double z, opacity, cx, cy, half_x, half_y;
};

/// Box of the dual conic by rows, without the local form.
bool set_box(Splat& s, double k2) {
  const glm::dvec3 metric(k2, k2, -1.0);
  const double d = glm::dot(metric * s.Tw, s.Tw);
  if (d == 0.0) return false;
  s.cx = glm::dot(metric * s.Tu, s.Tw) / d;
  s.cy = glm::dot(metric * s.Tv, s.Tw) / d;
  s.half_x = std::sqrt(std::max(1e-4, s.cx * s.cx - glm::dot(metric * s.Tu, s.Tu) / d));
  s.half_y = std::sqrt(std::max(1e-4, s.cy * s.cy - glm::dot(metric * s.Tv, s.Tv) / d));
  return true;
}

/// Alpha and expected depth of one program, pixel by pixel, in its coordinates.
struct Picture {
  std::vector<double> alpha, depth_m;
};

Picture second_implementation(const SurfelCloud& cloud, Compat compat,
                              const CameraPose& T_world_camera, const CameraIntrinsics& c) {
  const bool inria = compat == Compat::kInria;
  const double shift = inria ? 0.5 : 0.0;  // Of pixel centres and principal point.
  const auto T_camera_world = T_world_camera.inverse();
  std::vector<Splat> splats;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const glm::dmat3 R = glm::mat3_cast(T_camera_world.rotation()) *
                         glm::mat3_cast(glm::dquat(cloud.R_world_surfel[i]));
    const core::Point<core::frame::World> p_world{glm::dvec3(cloud.position_m[i])};
    const glm::dvec3 p = (T_camera_world * p_world).xyz_m;
    if (p.z <= static_cast<double>(0.2F) || (!inria && p.z >= 200.0)) continue;
    const glm::dvec3 u = R[0] * static_cast<double>(cloud.scale_m[i].x);
    const glm::dvec3 v = R[1] * static_cast<double>(cloud.scale_m[i].y);
    Splat s{};
    s.Tw = {u.z, v.z, p.z};
    s.Tu = c.fx_px * glm::dvec3(u.x, v.x, p.x) + (c.cx_px - shift) * s.Tw;
    s.Tv = c.fy_px * glm::dvec3(u.y, v.y, p.y) + (c.cy_px - shift) * s.Tw;
    s.z = p.z;
    s.opacity = cloud.opacity[i];
    if (set_box(s, inria ? 9.0 : 1.0)) splats.push_back(s);
  }
  std::stable_sort(splats.begin(), splats.end(),
                   [](const Splat& a, const Splat& b) { return a.z < b.z; });
  const auto in_tile = [&](const Splat& s, int tile_x, int tile_y) {
    if (inria) {
      const double r = std::ceil(std::max({s.half_x, s.half_y, 3.0 * 0.707106}));
      const auto inside = [&](double centre, int tile) {
        return tile >= std::trunc((centre - r) / 16.0) &&
               tile < std::trunc((centre + r + 15.0) / 16.0);
      };
      return inside(s.cx, tile_x) && inside(s.cy, tile_y);
    }
    const double rx = std::ceil(3.33 * s.half_x), ry = std::ceil(3.33 * s.half_y);
    return tile_x >= std::floor((s.cx - rx) / 16.0) &&
           tile_x < std::ceil((s.cx + rx) / 16.0) &&
           tile_y >= std::floor((s.cy - ry) / 16.0) && tile_y < std::ceil((s.cy + ry) / 16.0);
  };
  Picture picture;
  for (int row = 0; row < c.height_px; ++row) {
    for (int column = 0; column < c.width_px; ++column) {
      const double x = column + (inria ? 0.0 : 0.5), y = row + (inria ? 0.0 : 0.5);
      double T = 1.0, sum = 0.0;
      for (const Splat& s : splats) {
        if (!in_tile(s, column / 16, row / 16)) continue;
        const glm::dvec3 p = glm::cross(x * s.Tw - s.Tu, y * s.Tw - s.Tv);
        if (p.z == 0.0) continue;
        const double su = p.x / p.z, sv = p.y / p.z;
        const double rho_2d = 2.0 * ((x - s.cx) * (x - s.cx) + (y - s.cy) * (y - s.cy));
        const double z = su * s.Tw.x + sv * s.Tw.y + s.Tw.z;
        if (inria && z < static_cast<double>(0.2F)) continue;
        const double alpha =
            std::min(static_cast<double>(0.99F),
                     s.opacity * std::exp(-0.5 * std::min(su * su + sv * sv, rho_2d)));
        if (alpha < 1.0 / 255.0) continue;
        const double left = T * (1.0 - alpha);
        if (inria ? left < 1e-4 : left <= 1e-4) break;
        sum += T * alpha * (inria ? z : s.z);
        T = left;
      }
      picture.alpha.push_back(1.0 - T);
      picture.depth_m.push_back(sum / (1.0 - T));
    }
  }
  return picture;
}

class CompatSecondImplementation : public ::testing::TestWithParam<Compat> {};

TEST_P(CompatSecondImplementation, AgreesFromInsideAndOutside) {
  const CameraIntrinsics camera{77, 61, 70.0, 64.0, 36.3, 31.8};
  const CameraPose poses[] = {core::look_at({-4.5, 0.4, 1.0}, {0.0, 0.0, 0.0}),
                              core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2})};
  std::size_t compared = 0, off = 0;
  double changed = 0.0;
  for (std::uint64_t seed = 30; seed < 34; ++seed) {
    const SurfelCloud cloud = testing::random_scene(seed, 1200);
    const CameraPose& pose = poses[seed % 2];
    const Frame frame = render(cloud, GetParam(), camera, pose, DepthMode::kExpected);
    const Frame exact = render(cloud, Compat::kExact, camera, pose, DepthMode::kExpected);
    const Picture expected = second_implementation(cloud, GetParam(), pose, camera);
    for (std::size_t i = 0; i < expected.alpha.size(); ++i) {
      ++compared;
      const double alpha = frame.alpha.pixels()[i], depth_m = frame.depth_m.pixels()[i];
      changed =
          std::max(changed, std::abs(alpha - static_cast<double>(exact.alpha.pixels()[i])));
      off += std::abs(alpha - expected.alpha[i]) > 1e-6 ? 1 : 0;
      if (!std::isnan(depth_m)) {
        off += std::abs(depth_m - expected.depth_m[i]) > 1e-5 * std::abs(expected.depth_m[i])
                   ? 1
                   : 0;
      }
    }
  }
  // Rounding may decide whether a rounded-up radius reaches a tile, or alpha 1/255.
  EXPECT_LE(off, compared / 5000);
  EXPECT_GT(changed, 0.05);  // The rules matter here at all.
}

INSTANTIATE_TEST_SUITE_P(Programs, CompatSecondImplementation, ::testing::ValuesIn(kPrograms),
                         [](const auto& program) {
                           return program.param == Compat::kInria ? "Inria" : "Gsplat";
                         });

}  // namespace
}  // namespace segsim::renderer
