#include "renderer/scene/room_scene.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "renderer/scene/simd_target.h"

namespace segsim::renderer {
namespace {

SurfelCloud small_room(int surfels, std::uint64_t seed = 7, double spread = 1.0,
                       int rooms = 1) {
  RoomSceneOptions options;
  options.surfel_count = surfels;
  options.seed = seed;
  options.spread = spread;
  options.rooms = rooms;
  return make_room_scene(options);
}

double quantile(std::vector<float> values, double share) {
  const auto at = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<std::size_t>(at)];
}

constexpr double kFloor_m2 = kRoomSize_m.x * kRoomSize_m.y;
constexpr double kWalls_m2 = 2.0 * (kRoomSize_m.x + kRoomSize_m.y) * kRoomSize_m.z;

/// Surfels on a square metre of the shell, whose area is known; that of the boxes is random.
double density_on_shell(const SurfelCloud& room) {
  const auto shell = std::count_if(room.semantic_id.begin(), room.semantic_id.end(),
                                   [](std::uint16_t id) { return id < kRoomFirstBoxClass; });
  return static_cast<double>(shell) / (2.0 * kFloor_m2 + kWalls_m2);
}

TEST(RoomScene, IsValidAndDeterministic) {
  const SurfelCloud a = small_room(3000), b = small_room(3000), c = small_room(3000, 8);
  EXPECT_NO_THROW(check_surfels(a));
  EXPECT_EQ(a.size(), 3000U);
  EXPECT_EQ(a.position_m, b.position_m);
  EXPECT_EQ(a.opacity, b.opacity);
  EXPECT_EQ(a.sh, b.sh);
  EXPECT_NE(a.position_m, c.position_m);
}

TEST(RoomScene, OpacityIsTheMixtureOfTheTwoBetas) {
  // Quantiles of 0.6 Beta(8, 1.5) + 0.4 Beta(1.2, 3), by numerical integration here.
  const SurfelCloud room = small_room(60000);
  const auto density = [](double x, double a, double b) {
    return std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) +
                    (a - 1) * std::log(x) + (b - 1) * std::log1p(-x));
  };
  constexpr int kSteps = 20000;
  double sum = 0.0;
  std::vector<std::pair<double, double>> expected;  // Share, quantile.
  std::vector<double> shares{0.1, 0.25, 0.5, 0.75, 0.9};
  std::size_t next = 0;
  for (int i = 0; i < kSteps && next < shares.size(); ++i) {
    const double x = (i + 0.5) / kSteps;
    sum += (0.6 * density(x, 8.0, 1.5) + 0.4 * density(x, 1.2, 3.0)) / kSteps;
    if (sum >= shares[next]) expected.emplace_back(shares[next++], x);
  }
  ASSERT_EQ(expected.size(), shares.size());
  for (const auto& [share, value] : expected) {
    EXPECT_NEAR(quantile(room.opacity, share), value, 0.015) << "share " << share;
  }
  EXPECT_GE(*std::min_element(room.opacity.begin(), room.opacity.end()), 0.006F);
  EXPECT_LE(*std::max_element(room.opacity.begin(), room.opacity.end()), 0.995F);
}

TEST(RoomScene, ScalesAreLogNormalAboutTheSpacing) {
  constexpr int kCount = 40000;
  constexpr double kSpread = 1.6;
  const SurfelCloud room = small_room(kCount, 7, kSpread);
  const double expected_m = kSpread / std::sqrt(density_on_shell(room));
  double mean = 0.0, square = 0.0;
  for (const glm::vec2& scale_m : room.scale_m) {
    for (const double value : {std::log(scale_m.x), std::log(scale_m.y)}) {
      mean += value / (2.0 * kCount);
      square += value * value / (2.0 * kCount);
    }
  }
  EXPECT_NEAR(mean, std::log(expected_m), 0.01);
  EXPECT_NEAR(std::sqrt(square - mean * mean), 0.6, 0.01);
}

TEST(RoomScene, SurfelsLieByAreaOnSurfacesOfTheirClass) {
  constexpr int kCount = 50000;
  const SurfelCloud room = small_room(kCount);
  int walls = 0, floor = 0, ceiling = 0, boxes = 0, off = 0;
  for (std::size_t i = 0; i < room.size(); ++i) {
    const glm::dvec3 p(room.position_m[i]);
    const std::uint16_t semantic = room.semantic_id[i];
    double distance_m = 0.0;
    if (semantic == kRoomFloorClass) {
      ++floor;
      distance_m = std::abs(p.z);
    } else if (semantic == kRoomCeilingClass) {
      ++ceiling;
      distance_m = std::abs(p.z - kRoomSize_m.z);
    } else if (semantic == kRoomWallClass) {
      ++walls;
      distance_m = std::min({std::abs(p.x), std::abs(p.x - kRoomSize_m.x), std::abs(p.y),
                             std::abs(p.y - kRoomSize_m.y)});
    } else {
      ++boxes;
      EXPECT_EQ(semantic, kRoomFirstBoxClass + (room.instance_id[i] - 1) % kRoomBoxClasses);
      EXPECT_LT(p.z, 1.6 + 0.25);
    }
    EXPECT_EQ(room.instance_id[i] == 0, semantic < kRoomFirstBoxClass);
    off += distance_m > 0.02 ? 1 : 0;
  }
  const double expected = kFloor_m2 * density_on_shell(room);
  EXPECT_NEAR(floor, expected, 6.0 * std::sqrt(expected));
  EXPECT_NEAR(ceiling, expected, 6.0 * std::sqrt(expected));
  EXPECT_NEAR(walls, expected * kWalls_m2 / kFloor_m2, 6.0 * std::sqrt(2.0 * expected));
  EXPECT_EQ(boxes, kCount - floor - ceiling - walls);
  // One in five is off by N(0, sqrt(0.03^2 + 0.004^2)): beyond 20 mm are 2 (1 - Phi(0.661)).
  const double shell = floor + ceiling + walls;
  EXPECT_NEAR(off / shell, 0.2 * 0.5087, 0.01);
}

TEST(RoomScene, NormalsPointAlongTheSurfacesTilted) {
  const SurfelCloud room = small_room(20000);
  double sum = 0.0;
  int count = 0;
  for (std::size_t i = 0; i < room.size(); ++i) {
    if (room.semantic_id[i] != kRoomFloorClass) continue;
    const glm::vec3 normal = room.R_world_surfel[i] * glm::vec3(0.0F, 0.0F, 1.0F);
    ASSERT_GT(normal.z, 0.0F);
    sum += (normal.x * normal.x + normal.y * normal.y) / (normal.z * normal.z);
    ++count;
  }
  ASSERT_GT(count, 1000);
  EXPECT_NEAR(sum / count, 2.0 * 0.15 * 0.15, 0.004);  // tan^2 of the tilt, two axes.
}

TEST(RoomScene, FurtherRoomsLieBesideTheFirstAndLeaveItUnchanged) {
  const SurfelCloud one = small_room(2000), five = small_room(2000, 7, 1.0, 5);
  ASSERT_EQ(five.size(), 5U * one.size());
  EXPECT_TRUE(
      std::equal(one.position_m.begin(), one.position_m.end(), five.position_m.begin()));
  std::vector<glm::vec3> centres;
  for (std::size_t room = 0; room < 5; ++room) {
    glm::vec3 low(1e9F), high(-1e9F);
    for (std::size_t i = room * 2000; i < (room + 1) * 2000; ++i) {
      low = glm::min(low, five.position_m[i]);
      high = glm::max(high, five.position_m[i]);
    }
    centres.push_back(0.5F * (low + high));
  }
  for (std::size_t a = 0; a < 5; ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      const glm::vec3 d = glm::abs(centres[a] - centres[b]);
      EXPECT_TRUE(d.x > 8.0F || d.y > 6.0F) << a << " overlaps " << b;
    }
  }
  EXPECT_GT(*std::max_element(five.instance_id.begin(), five.instance_id.end()),
            4 * kRoomBoxes);
}

TEST(RoomScene, FeaturesClusterByInstance) {
  RoomSceneOptions options;
  options.surfel_count = 3000;
  options.features = true;
  const SurfelCloud room = make_room_scene(options);
  ASSERT_TRUE(room.has_features());
  EXPECT_EQ(room.position_m, small_room(3000).position_m);
  double same = 0.0, other = 0.0;
  int same_count = 0, other_count = 0;
  for (std::size_t i = 1; i < room.size(); ++i) {
    double distance2 = 0.0;
    for (std::size_t c = 0; c < core::kSemanticFeatureSize; ++c) {
      const double d = room.semantic_feature[i][c] - room.semantic_feature[i - 1][c];
      distance2 += d * d;
    }
    const bool equal = room.instance_id[i] == room.instance_id[i - 1];
    (equal ? same : other) += distance2;
    ++(equal ? same_count : other_count);
  }
  EXPECT_NEAR(same / same_count, 2.0 * 16 * 0.01, 0.04);
  EXPECT_GT(other / other_count, 8.0);
}

TEST(RoomScene, CamerasAreThoseOfTheStandardRing) {
  const core::CameraIntrinsics camera = room_camera(1296, 968);
  EXPECT_DOUBLE_EQ(camera.fx_px, 1165.7);
  EXPECT_DOUBLE_EQ(camera.fy_px, 1165.7);
  EXPECT_DOUBLE_EQ(camera.cx_px, 648.0);
  EXPECT_DOUBLE_EQ(camera.cy_px, 484.0);
  EXPECT_NEAR(room_camera(648, 400).fx_px, 0.5 * 1165.7, 1e-9);

  // View 2 of 8: eye (4, 4.8, 1.3) looks at (4, 1.6, 0.9).
  const auto ring = room_camera_ring(8);
  ASSERT_EQ(ring.size(), 8U);
  EXPECT_NEAR(glm::distance(ring[2].translation_m(), glm::dvec3(4.0, 4.8, 1.3)), 0.0, 1e-9);
  const glm::dvec3 forward = glm::normalize(glm::dvec3(0.0, -3.2, -0.4));
  EXPECT_NEAR(glm::distance(ring[2].rotation() * glm::dvec3(0, 0, 1), forward), 0.0, 1e-9);
  EXPECT_NEAR(glm::distance(ring[2].rotation() * glm::dvec3(1, 0, 0), glm::dvec3(-1, 0, 0)),
              0.0, 1e-9);
}

TEST(RoomScene, RefusesOptionsOutOfRange) {
  EXPECT_THROW(small_room(0), core::ContractViolation);
  EXPECT_THROW(small_room(10, 7, 0.0), core::ContractViolation);
  EXPECT_THROW(small_room(10, 7, -1.0), core::ContractViolation);
  EXPECT_THROW(small_room(10, 7, 1.0, 0), core::ContractViolation);
}

TEST(SimdTarget, HasAName) {
  EXPECT_FALSE(simd_target().empty());
  EXPECT_NE(simd_target(), "Unknown");
}

}  // namespace
}  // namespace segsim::renderer
