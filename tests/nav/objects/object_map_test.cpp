#include "nav/objects/object_map.h"

#include <vector>

#include <gmock/gmock.h>

#include "core/check.h"
#include "nav/objects/internal/object_clusters.h"
#include "tests/nav/box_world.h"

namespace segsim::nav {
namespace {

using test::Box;
using test::BoxWorld;
using test::Simulation;
using test::SimulationOptions;
using test::WorldBuilder;

/// A room of 8 m x 8 m with the object ahead of a robot at the origin.
BoxWorld room_with(const Box& object) {
  WorldBuilder b;
  b.wall_x(-4, -4, 4);
  b.wall_x(4, -4, 4);
  b.wall_y(-4, -4, 4);
  b.wall_y(4, -4, 4);
  b.world.object = object;
  return b.world;
}
const Box kCabinet{{2.0, -0.3, 0.0}, {2.5, 0.3, 1.0}};

TEST(LiftDetection, FrontFaceWithinTenCentimetresDespiteNoise) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    SimulationOptions options;
    options.depth_noise = 0.01;
    options.box_jitter_px = 2.0;
    options.seed = seed;
    Simulation simulation(room_with(kCabinet), {0, 0, 0.1}, options);
    const core::Observation& observation = simulation.observe();
    const auto detections = simulation.detect();
    ASSERT_EQ(detections.size(), 1U);
    const LiftedDetection lifted = lift_detection(observation, detections[0], {});
    ASSERT_GT(lifted.cloud_m.size(), 20U);
    EXPECT_NEAR(lifted.range_m, 2.0, 0.1);
    // The camera sees the front face at x = 2; its middle is at y = 0.
    EXPECT_NEAR(lifted.center_m.x, 2.0, 0.1);
    EXPECT_NEAR(lifted.center_m.y, 0.0, 0.1);
    for (const glm::vec3& p : lifted.cloud_m) EXPECT_NEAR(p.x, 2.0F, 0.35F);
  }
}

TEST(LiftDetection, TakesTheObjectNotTheWallBehindIt) {
  Simulation simulation(room_with(kCabinet), {0, 0, 0}, {});
  const core::Observation& observation = simulation.observe();
  core::Detection wide = simulation.detect()[0];
  // A sloppy box, twice as wide: more than half of it is wall.
  const float half = 0.5F * wide.box.width_px();
  wide.box.x0 -= half;
  wide.box.x1 += half;
  const LiftedDetection lifted = lift_detection(observation, wide, {});
  EXPECT_NEAR(lifted.center_m.x, 2.0, 0.1);
}

TEST(LiftDetection, NothingWithoutDepthInsideOrOutsideOfTheImage) {
  Simulation simulation(room_with(kCabinet), {0, 0, 0}, {});
  core::Observation observation = simulation.observe();
  EXPECT_TRUE(
      lift_detection(observation, {0, 0.9F, {-50, -50, -10, -10}}, {}).cloud_m.empty());
  EXPECT_TRUE(lift_detection(observation, {0, 0.9F, {20, 20, 20, 40}}, {}).cloud_m.empty());
  // Mostly holes: an object beyond the depth range, with a bit of something near at its edge.
  core::Image<float> holes(128, 96, std::numeric_limits<float>::quiet_NaN());
  for (int y = 30; y < 60; ++y) holes(40, y) = holes(41, y) = 2.0F;
  observation.depth_m = &holes;
  EXPECT_TRUE(lift_detection(observation, {0, 0.9F, {30, 30, 80, 60}}, {}).cloud_m.empty());
}

/// Feeds what a robot sees that drives towards the object; every `detect_every`-th view
/// detects.
ObjectMap drive(const BoxWorld& world, double from_x, double to_x, int views, int detect_every,
                const ObjectMapOptions& options = {}) {
  ObjectMap objects(options);
  for (int k = 0; k < views; ++k) {
    const double x = from_x + (to_x - from_x) * k / std::max(1, views - 1);
    SimulationOptions simulation_options;
    Simulation simulation(world, {x, 0, 0}, simulation_options);
    core::Observation observation = simulation.observe();
    observation.capture_time_ns = k * core::kNsPerSecond / 5;
    const auto detections = simulation.detect();
    objects.update(
        observation,
        k % detect_every == 0 ? std::span(detections) : std::span<core::Detection>{}, 0);
  }
  return objects;
}

TEST(ObjectMap, CutsOffWhatALaterBoxLeavesOut) {
  // A cupboard flush with the object shares its box at first.
  BoxWorld world = room_with(kCabinet);
  world.boxes.push_back({{2.0, 0.3, 0.0}, {2.5, 1.1, 1.0}});
  Simulation simulation(world, {0, 0, 0}, {});
  const core::Observation& observation = simulation.observe();
  const core::Detection tight = simulation.detect().at(0);
  core::Detection wide = tight;
  wide.box.x0 -= 1.2F * wide.box.width_px();  // Left in the image is +y.
  ObjectMap objects;
  objects.update(observation, {&wide, 1}, 0);
  ASSERT_EQ(objects.objects().size(), 1U);
  EXPECT_GT(objects.objects()[0].high_m.y, 0.5);
  objects.update(observation, {&tight, 1}, 0);
  ASSERT_EQ(objects.objects().size(), 1U);
  EXPECT_LT(objects.objects()[0].high_m.y, 0.42);
  EXPECT_NEAR(objects.objects()[0].center_m.x, 2.0, 0.1);
}

TEST(ObjectMap, TheBetterNameOfABoxIsBelieved) {
  Simulation simulation(room_with(kCabinet), {0, 0, 0}, {});
  const core::Observation& observation = simulation.observe();
  core::Detection wanted = simulation.detect().at(0);
  wanted.score = 0.5F;
  core::Detection other = wanted;
  other.class_index = 1;
  const auto objects_with = [&](float score, float shift_px) {
    other.score = score;
    other.box = wanted.box;
    other.box.x0 += shift_px;
    other.box.x1 += shift_px;
    ObjectMap objects;
    objects.update(observation, std::vector{wanted, other}, 0);
    return objects.objects().size();
  };
  EXPECT_EQ(objects_with(0.6F, 0.0F), 0U);  // The other name is more certain.
  EXPECT_EQ(objects_with(0.4F, 0.0F), 1U);
  EXPECT_EQ(objects_with(0.5F, 0.0F), 1U);  // An oracle's boxes all have one score.
  // Beside it is another thing: half the width away the boxes share a third.
  EXPECT_EQ(objects_with(0.6F, 0.5F * wanted.box.width_px()), 1U);
  ObjectMapOptions trusting;
  trusting.rival_iou = 1.0;
  ObjectMap objects(trusting);
  other.box = wanted.box;
  objects.update(observation, std::vector{wanted, other}, 0);
  EXPECT_EQ(objects.objects().size(), 1U);
}

TEST(ObjectMap, OneObjectFromManyViewsIsConfirmed) {
  const ObjectMap objects = drive(room_with(kCabinet), -2.0, 0.5, 12, 1);
  ASSERT_EQ(objects.objects().size(), 1U);
  const MappedObject& object = objects.objects()[0];
  EXPECT_EQ(object.id, 0);
  EXPECT_EQ(object.status, ObjectStatus::kConfirmed);
  EXPECT_NEAR(object.planar_distance_m({0.0, 0.0}), 2.0, 0.1);
  // The core of the cabinet's 0.6 m: boxes are cut by 35 % and extents by 10 % a side.
  EXPECT_NEAR(object.low_m.y, -0.3 * 0.65 * 0.8, 0.05);
  EXPECT_NEAR(object.high_m.y, 0.3 * 0.65 * 0.8, 0.05);
}

/// A much nearer view replaces the cloud, a much farther one adds nothing to it.
TEST(ObjectMap, SaysWhichDetectionsItsCloudIsMadeOf) {
  ObjectMap objects;
  std::vector<std::uint64_t> captures;
  const auto look_from = [&](double x, std::uint64_t capture_index) {
    Simulation simulation(room_with(kCabinet), {x, 0, 0}, {});
    core::Observation observation = simulation.observe();
    observation.capture_index = capture_index;
    const std::vector<core::Detection> detections = simulation.detect();
    objects.update(observation, detections, 0);
    ASSERT_EQ(objects.objects().size(), 1U);
    captures.clear();
    for (const core::DetectionRef& ref : objects.objects()[0].made_of) {
      captures.push_back(ref.capture_index);
    }
    if (captures.back() != capture_index) return;
    EXPECT_EQ(core::iou(objects.objects()[0].made_of.back().box, detections.at(0).box), 1.0F);
  };
  look_from(-2.0, 3);  // 4 m.
  look_from(-1.8, 7);  // 3.8 m: more of the same.
  EXPECT_EQ(captures, (std::vector<std::uint64_t>{3, 7}));
  look_from(0.2, 8);  // 1.8 m, less than 0.6 of 3.8 m.
  EXPECT_EQ(captures, (std::vector<std::uint64_t>{8}));
  look_from(-2.0, 9);  // 4 m, more than 1.8 times as far.
  EXPECT_EQ(captures, (std::vector<std::uint64_t>{8}));
}

TEST(ObjectMap, OneSightingStaysTentativeAndIsRefutedFromNear) {
  const ObjectMap before = drive(room_with(kCabinet), 0.0, 0.0, 1, 1);
  ASSERT_EQ(before.objects().size(), 1U);
  EXPECT_EQ(before.objects()[0].status, ObjectStatus::kTentative);
  const ObjectMap after = drive(room_with(kCabinet), -0.45, 1.0, 14, 100);
  ASSERT_EQ(after.objects().size(), 1U);
  EXPECT_EQ(after.objects()[0].status, ObjectStatus::kRefuted);
}

TEST(ObjectMap, MissesFarAwayOrBehindAWallDoNotCount) {
  EXPECT_EQ(drive(room_with(kCabinet), -3.0, -1.0, 15, 100).objects()[0].misses, 0.0);
  ObjectMap objects = drive(room_with(kCabinet), 0.0, 0.0, 1, 1);
  BoxWorld hidden = room_with(kCabinet);
  hidden.boxes.push_back({{1.5, -1.5, 0.0}, {1.6, 1.5, 2.5}});
  for (int k = 0; k < 10; ++k) {
    Simulation simulation(hidden, {0.1 * k, 0, 0}, {});
    objects.update(simulation.observe(), {}, 0);
  }
  EXPECT_EQ(objects.objects()[0].misses, 0.0);
}

TEST(ObjectMap, StandingStillAddsLittleEvidence) {
  const ObjectMap objects = drive(room_with(kCabinet), 0.0, 0.0, 6, 1);  // One second.
  EXPECT_LE(objects.objects()[0].sightings, 2.0);
  EXPECT_EQ(objects.objects()[0].status, ObjectStatus::kTentative);
}

TEST(ObjectMap, FarObjectsAreNotTrusted) {
  ObjectMapOptions options;
  options.trusted_range_m = 1.5;
  const ObjectMap objects = drive(room_with(kCabinet), -2.0, 0.3, 12, 1, options);
  EXPECT_GE(objects.objects()[0].sightings, 5.0);
  EXPECT_EQ(objects.objects()[0].status, ObjectStatus::kTentative);
}

TEST(ObjectMap, RefutedObjectsAbsorbDetectionsUntilTheyAreMany) {
  ObjectMap objects = drive(room_with(kCabinet), -1.0, 0.0, 5, 1);
  objects.refute(0);
  int views = 0;
  for (; views < 20 && objects.objects()[0].status == ObjectStatus::kRefuted; ++views) {
    Simulation simulation(room_with(kCabinet), {-1.0 + 0.15 * views, 0, 0}, {});
    const core::Observation& observation = simulation.observe();
    objects.update(observation, simulation.detect(), 0);
  }
  EXPECT_EQ(objects.objects().size(), 1U);
  EXPECT_EQ(views, 6);
  objects.refute(0);  // The second time is final.
  for (int k = 0; k < 15; ++k) {
    Simulation simulation(room_with(kCabinet), {-1.0 + 0.15 * k, 0, 0}, {});
    const core::Observation& observation = simulation.observe();
    objects.update(observation, simulation.detect(), 0);
  }
  EXPECT_EQ(objects.objects()[0].status, ObjectStatus::kRefuted);
}

TEST(ObjectMap, OtherClassesAndUnknownIdsAreHandled) {
  ObjectMap objects;
  Simulation simulation(room_with(kCabinet), {0, 0, 0}, {});
  const core::Observation& observation = simulation.observe();
  objects.update(observation, simulation.detect(), 3);
  objects.update(observation, simulation.detect(), -1);
  EXPECT_TRUE(objects.objects().empty());
  EXPECT_EQ(objects.find(0), nullptr);
  EXPECT_THROW(objects.refute(0), core::ContractViolation);
}

/// Sizes of the groups of points with gaps up to `gap_m`, by the definition.
std::size_t largest_group_size(const std::vector<glm::vec3>& points, double gap_m) {
  std::vector<bool> visited(points.size(), false);
  std::size_t largest = 0;
  for (std::size_t first = 0; first < points.size(); ++first) {
    if (visited[first]) continue;
    std::vector<std::size_t> group{first};
    visited[first] = true;
    for (std::size_t k = 0; k < group.size(); ++k) {
      for (std::size_t n = 0; n < points.size(); ++n) {
        if (visited[n] || glm::distance(points[group[k]], points[n]) > gap_m) continue;
        visited[n] = true;
        group.push_back(n);
      }
    }
    largest = std::max(largest, group.size());
  }
  return largest;
}

TEST(ObjectClusters, LargestGroupByTheDefinition) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    core::RandomStream random(seed, "clusters");
    std::vector<glm::vec3> points;
    for (int k = 0; k < 300; ++k) {
      points.emplace_back(random.uniform(0, 2), random.uniform(0, 1), random.uniform(0, 1));
    }
    const double gap_m = random.uniform(0.08, 0.2);
    const auto cluster = internal::largest_cluster(points, gap_m, 1);
    EXPECT_EQ(cluster.size(), largest_group_size(points, gap_m)) << seed;
    EXPECT_TRUE(internal::largest_cluster(points, gap_m, static_cast<int>(cluster.size()) + 1)
                    .empty());
  }
}

/// Gaps that differ by less than rounding may are for PCL to judge.
TEST(ObjectClusters, AboutTheGap) {
  std::vector<glm::vec3> points;
  for (int k = 0; k < 4; ++k) points.emplace_back(0.1F * static_cast<float>(k), 0.0F, 0.0F);
  points.emplace_back(0.3F + 0.25F * (1.0F - 1e-5F), 0.0F, 0.0F);
  EXPECT_EQ(internal::largest_cluster(points, 0.25, 1).size(), 5U);
  points.back().x = 0.3F + 0.25F * (1.0F + 1e-5F);
  EXPECT_EQ(internal::largest_cluster(points, 0.25, 1).size(), 4U);
  // Of equals the first.
  points = {{0.0F, 0.0F, 0.0F}, {5.0F, 0.0F, 0.0F}, {0.1F, 0.0F, 0.0F}, {5.1F, 0.0F, 0.0F}};
  EXPECT_EQ(internal::largest_cluster(points, 0.25, 1).front().x, 0.0F);
}

}  // namespace
}  // namespace segsim::nav
