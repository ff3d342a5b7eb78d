#include "nav/mapping/occupancy_map.h"

#include <gmock/gmock.h>

#include "core/check.h"
#include "tests/nav/box_world.h"

namespace segsim::nav {
namespace {

using test::BoxWorld;
using test::Simulation;
using test::SimulationOptions;
using test::WorldBuilder;

/// A room of 6 m x 6 m around the origin.
WorldBuilder room() {
  WorldBuilder b;
  b.wall_x(-3, -3, 3);
  b.wall_x(3, -3, 3);
  b.wall_y(-3, -3, 3);
  b.wall_y(3, -3, 3);
  return b;
}

CellState state_at(const OccupancyMap& map, double x, double y) {
  return map.body_state(map.frame().cell_at({x, y}));
}

/// Whether something hangs here between body and camera height.
bool mast_blocked(const OccupancyMap& map, const Cell& cell) {
  return map.mast_log_odds()(cell.x, cell.y) > map.options().occupied_above;
}

TEST(OccupancyMap, SeesWallAndFloorAndLeavesTheRestUnknown) {
  Simulation simulation(room().world, {0, 0, 0}, {});
  OccupancyMap map;
  map.integrate(simulation.observe());
  EXPECT_EQ(state_at(map, 2.98, 0.0), CellState::kOccupied);
  for (double x = 0.0; x < 2.8; x += 0.05)
    EXPECT_EQ(state_at(map, x, 0.0), CellState::kFree) << x;
  EXPECT_EQ(state_at(map, 3.5, 0.0), CellState::kUnknown);   // Behind the wall.
  EXPECT_EQ(state_at(map, -2.5, 0.0), CellState::kUnknown);  // Behind the robot.
}

TEST(OccupancyMap, HoldsForAPitchedCameraOffTheCentre) {
  SimulationOptions options;
  options.pitch_down_rad = 0.35;
  options.camera_forward_m = 0.15;
  Simulation simulation(room().world, {0.4, -0.3, 1.1}, options);
  OccupancyMap map;
  map.integrate(simulation.observe());
  // Every occupied cell lies on a wall.
  int occupied = 0;
  for (int j = 0; j < map.frame().height_cells; ++j) {
    for (int i = 0; i < map.frame().width_cells; ++i) {
      if (map.body_state({i, j}) != CellState::kOccupied) continue;
      ++occupied;
      const glm::dvec2 p = map.frame().center_m({i, j});
      EXPECT_NEAR(std::max(std::abs(p.x), std::abs(p.y)), 2.95, 0.06);
    }
  }
  EXPECT_GT(occupied, 30);
}

/// The oracle is the geometry: an obstacle that went away is cleared only by rays at its
/// height.
TEST(OccupancyMap, ClearsWhatIsGoneAndKeepsWhatItLooksOver) {
  WorldBuilder with = room();
  with.add(1.8, -0.3, 0.0, 2.2, 0.3, 0.45);
  OccupancyMap map;
  Simulation before(with.world, {-1.0, 0, 0}, {});
  for (int k = 0; k < 3; ++k) map.integrate(before.observe());
  ASSERT_EQ(state_at(map, 1.82, 0.0), CellState::kOccupied);

  // From near the box is below the image; rays pass above it to the wall.
  OccupancyMap near = map;
  Simulation close(with.world, {1.2, 0, 0}, {});
  for (int k = 0; k < 30; ++k) near.integrate(close.observe());
  EXPECT_EQ(state_at(near, 1.82, 0.0), CellState::kOccupied);

  // Taken away: rays go through where it was.
  Simulation after(room().world, {-1.0, 0, 0}, {});
  for (int k = 0; k < 30; ++k) map.integrate(after.observe());
  EXPECT_EQ(state_at(map, 1.82, 0.0), CellState::kFree);
}

TEST(OccupancyMap, TableTopBlocksTheMastOnly) {
  WorldBuilder b = room();
  b.table(1.0, -0.5, 2.0, 0.5);
  OccupancyMap map;
  SimulationOptions options;
  options.camera = core::CameraIntrinsics::from_fov(256, 192, 1.3788);
  Simulation simulation(b.world, {-1.0, 0, 0}, options);
  for (int k = 0; k < 3; ++k) map.integrate(simulation.observe());
  const Cell middle = map.frame().cell_at({1.5, 0.0});
  // Rows of pixels fall on every other cell of the top.
  bool blocked = false;
  for (int di = -2; di <= 2; ++di) blocked |= mast_blocked(map, middle + Cell(di, 0));
  EXPECT_TRUE(blocked);
  EXPECT_EQ(map.body_state(middle), CellState::kFree);
  EXPECT_EQ(state_at(map, 1.02, -0.48), CellState::kOccupied);  // A leg.
}

TEST(OccupancyMap, WallInTheBlindZoneStandsOnTheFloor) {
  OccupancyMap map;
  Simulation simulation(room().world, {2.45, 0, 0}, {});  // The wall begins at 2.95.
  map.integrate(simulation.observe());
  map.integrate(simulation.observe());  // The first one only outweighs the assumption.
  // Its face lies on the border of two cells.
  EXPECT_TRUE(state_at(map, 2.97, 0.0) == CellState::kOccupied ||
              state_at(map, 2.93, 0.0) == CellState::kOccupied);
}

/// From so near that the body's band lies below the image, a table top is seen and its legs
/// are not: the body fits below, which a narrow place between tables depends on.
TEST(OccupancyMap, TableTopInTheBlindZoneBlocksTheMastOnly) {
  WorldBuilder b = room();
  b.table(1.0, -0.8, 2.0, 0.8);
  SimulationOptions simulated;
  simulated.camera = core::CameraIntrinsics::from_fov(256, 192, 1.3788);
  Simulation simulation(b.world, {0.35, 0, 0}, simulated);
  for (const double wall_part_m : {0.0, 0.2}) {
    OccupancyOptions options;
    options.wall_part_m = wall_part_m;
    OccupancyMap map(options);
    for (int k = 0; k < 3; ++k) map.integrate(simulation.observe());
    bool mast = false, body = false;
    for (double x = 1.02; x < 1.15; x += 0.05) {
      mast |= mast_blocked(map, map.frame().cell_at({x, 0.0}));
      body |= state_at(map, x, 0.0) == CellState::kOccupied;
    }
    EXPECT_TRUE(mast);
    EXPECT_EQ(body, wall_part_m == 0.0);
  }
}

TEST(OccupancyMap, GrowsAndKeepsWhatItKnew) {
  OccupancyMap map;
  Simulation here(room().world, {0, 0, 0}, {});
  map.integrate(here.observe());
  const int width = map.frame().width_cells;
  Simulation far(room().world, {-20.0, 13.0, 2.0}, {});
  map.integrate(far.observe());
  EXPECT_GT(map.frame().width_cells, width);
  EXPECT_EQ(state_at(map, 2.98, 0.0), CellState::kOccupied);
  EXPECT_EQ(state_at(map, 1.0, 0.0), CellState::kFree);
  EXPECT_EQ(state_at(map, -20.0, 13.0), CellState::kFree);
}

TEST(OccupancyMap, BlockedDiscSurvivesRaysButNotTheRobot) {
  OccupancyMap map;
  Simulation simulation(room().world, {-1.0, 0, 0}, {});
  map.integrate(simulation.observe());
  map.mark_blocked_disc({1.0, 0.0}, 0.1);
  for (int k = 0; k < 20; ++k) map.integrate(simulation.observe());
  EXPECT_EQ(state_at(map, 1.0, 0.0), CellState::kOccupied);
  map.mark_free_disc({1.0, 0.0}, 0.1);
  EXPECT_EQ(state_at(map, 1.0, 0.0), CellState::kFree);
}

TEST(OccupancyMap, WhatWasFeltCanBeForgotten) {
  OccupancyMap map;
  Simulation simulation(room().world, {-1.0, 0, 0}, {});
  map.integrate(simulation.observe());
  map.mark_blocked_disc({1.0, 0.0}, 0.1);
  map.mark_blocked_disc({2.98, 0.0}, 0.1);  // At the wall.
  (void)map.take_changed();
  map.forget_blocked();
  EXPECT_EQ(state_at(map, 1.0, 0.0), CellState::kUnknown);
  EXPECT_TRUE(map.take_changed().contains(map.frame().cell_at({1.0, 0.0})));
  // What is there is seen again.
  map.integrate(simulation.observe());
  EXPECT_EQ(state_at(map, 1.0, 0.0), CellState::kFree);
  EXPECT_EQ(state_at(map, 2.98, 0.0), CellState::kOccupied);
}

TEST(OccupancyMap, AllNanAndInfinityChangeNothingBeyondTheFootprint) {
  Simulation simulation(room().world, {0, 0, 0}, {});
  core::Observation observation = simulation.observe();
  core::Image<float> nothing(128, 96, std::numeric_limits<float>::quiet_NaN());
  for (int y = 0; y < 40; ++y) nothing(y, y) = std::numeric_limits<float>::infinity();
  observation.depth_m = &nothing;
  OccupancyMap map;
  map.integrate(observation);
  EXPECT_EQ(state_at(map, 2.5, 0.0), CellState::kUnknown);
  EXPECT_EQ(state_at(map, 0.0, 0.2), CellState::kFree);
}

/// A pillar before the far wall; the pixel column at each of its edges gets a depth in
/// between, as a camera that blends fore- and background delivers it.
TEST(OccupancyMap, FlyingPixelsAreNoObstacles) {
  WorldBuilder b = room();
  b.add(0.0, -0.2, 0.0, 0.2, 0.2, 2.0);
  SimulationOptions simulated;
  simulated.camera = core::CameraIntrinsics::from_fov(256, 192, 1.3788);
  simulated.pitch_down_rad = 0.2;
  Simulation simulation(b.world, {-1.5, 0, 0}, simulated);
  core::Observation observation = simulation.observe();
  core::Image<float> depth_m = *observation.depth_m;
  for (int y = 0; y < depth_m.height_px(); ++y) {
    const float* clean = observation.depth_m->row(y);
    for (int x = 2; x + 2 < depth_m.width_px(); ++x) {
      // Before and after the step: one pixel in the middle between both.
      if (std::abs(clean[x + 1] - clean[x]) > 0.5F) {
        depth_m(x, y) = 0.5F * (clean[x] + clean[x + 1]);
      }
    }
  }
  observation.depth_m = &depth_m;
  // Occupied cells in the open floor between the pillar and the wall.
  const auto specks = [&](bool reject) {
    OccupancyOptions options;
    options.reject_flying_pixels = reject;
    OccupancyMap map(options);
    for (int k = 0; k < 3; ++k) map.integrate(observation);
    EXPECT_EQ(state_at(map, 0.02, 0.0), CellState::kOccupied);
    int count = 0;
    for (double x = 0.35; x < 2.7; x += 0.05) {
      for (double y = -2.5; y < 2.5; y += 0.05) {
        count += state_at(map, x, y) == CellState::kOccupied ? 1 : 0;
      }
    }
    return count;
  };
  EXPECT_GT(specks(false), 0);
  EXPECT_EQ(specks(true), 0);
}

TEST(OccupancyMap, SlantedWallsAreNotTakenForFlyingPixels) {
  // Along a wall every pixel lies between its neighbours.
  SimulationOptions simulated;
  simulated.camera = core::CameraIntrinsics::from_fov(256, 192, 1.3788);
  Simulation simulation(room().world, {-2.0, -2.2, 0.0}, simulated);
  const core::Observation& observation = simulation.observe();
  const auto wall_cells = [&](bool reject) {
    OccupancyOptions options;
    options.reject_flying_pixels = reject;
    OccupancyMap map(options);
    map.integrate(observation);
    int count = 0;
    for (double x = -1.0; x < 2.5; x += 0.05) {
      count += state_at(map, x, -2.97) == CellState::kOccupied ||
                       state_at(map, x, -2.93) == CellState::kOccupied
                   ? 1
                   : 0;
    }
    return count;
  };
  EXPECT_GT(wall_cells(false), 30);
  EXPECT_EQ(wall_cells(true), wall_cells(false));
}

TEST(OccupancyMap, FloorSeenInACellClearsASpeck) {
  SimulationOptions simulated;
  simulated.camera = core::CameraIntrinsics::from_fov(256, 192, 1.3788);
  Simulation simulation(room().world, {-1.0, 0, 0}, simulated);
  core::Observation observation = simulation.observe();
  const core::Image<float> clean = *observation.depth_m;
  // Some pixels that show the floor 2.5 m ahead claim an obstacle of 0.15 m there.
  core::Image<float> dirty = clean;
  const double eye_m = simulated.mast_m, fy = simulated.camera.fy_px;
  for (int y = 0; y < dirty.height_px(); ++y) {
    const double down = (y + 0.5 - simulated.camera.cy_px) / fy;
    const double depth_m = (eye_m - 0.15) / down;
    if (down <= 0.0 || std::abs(depth_m - 2.5) > 0.1) continue;
    for (int x = 120; x < 136; ++x) dirty(x, y) = static_cast<float>(depth_m);
  }
  OccupancyMap map;
  observation.depth_m = &dirty;
  map.integrate(observation);
  const auto occupied = [&] {
    int count = 0;
    for (double x = 1.3; x < 1.7; x += 0.05) {
      for (double y = -0.3; y < 0.3; y += 0.05) {
        count += state_at(map, x, y) == CellState::kOccupied ? 1 : 0;
      }
    }
    return count;
  };
  EXPECT_GT(occupied(), 0);
  observation.depth_m = &clean;
  for (int k = 0; k < 4; ++k) map.integrate(observation);
  EXPECT_EQ(occupied(), 0);
}

/// The same hole in the floor in view and behind an obstacle.
TEST(OccupancyMap, FloorWithoutDepthIsPresumedFreeOnlyInPlainView) {
  for (const bool hidden : {false, true}) {
    WorldBuilder b = room();
    if (hidden) b.add(0.6, -2.9, 0.0, 0.8, 2.9, 0.9);
    SimulationOptions simulated;
    simulated.camera = core::CameraIntrinsics::from_fov(256, 192, 1.3788);
    Simulation simulation(b.world, {-1.0, 0, 0}, simulated);
    core::Observation observation = simulation.observe();
    core::Image<float> depth_m = *observation.depth_m;
    OccupancyMap map;
    map.integrate(observation);  // The obstacle is known, if there is one.
    OccupancyMap fresh;
    for (int y = 0; y < depth_m.height_px(); ++y) {
      for (int x = 0; x < depth_m.width_px(); ++x) {
        const double down = (y + 0.5 - simulated.camera.cy_px) / simulated.camera.fy_px;
        const double floor_m = down > 0.0 ? simulated.mast_m / down : 1e3;
        if (floor_m > 2.0 && floor_m < 4.2) {
          depth_m(x, y) = std::numeric_limits<float>::quiet_NaN();
        }
      }
    }
    observation.depth_m = &depth_m;
    OccupancyMap& looking = hidden ? map : fresh;
    for (int k = 0; k < looking.options().hole_views; ++k) {
      EXPECT_EQ(state_at(looking, 1.3, 0.0), CellState::kUnknown);
      looking.integrate(observation);
    }
    EXPECT_EQ(state_at(looking, 1.3, 0.0), hidden ? CellState::kUnknown : CellState::kFree);
  }
}

TEST(OccupancyMap, RefusesWrongInput) {
  Simulation simulation(room().world, {0, 0, 0}, {});
  core::Observation observation = simulation.observe();
  OccupancyMap map;
  observation.depth_m = nullptr;
  EXPECT_THROW(map.integrate(observation), core::ContractViolation);
  const core::Image<float> small(4, 4);
  observation.depth_m = &small;
  EXPECT_THROW(map.integrate(observation), core::ContractViolation);
  OccupancyOptions options;
  options.growth.resolution_m = 0.0;
  EXPECT_THROW(OccupancyMap{options}, core::ContractViolation);
}

}  // namespace
}  // namespace segsim::nav
