// Plans a path on a map and drives it, without a camera or a simulator.
//
//     plan_on_map
//
// The floor plan below becomes a grid, the grid a cost map for a robot of a given radius; A*
// finds the way from S to G, and pure pursuit drives it. Writes map.ppm into the current
// folder: free floor white, too close to a wall grey, walls black, the planned path blue, the
// drive red.

#include <array>
#include <iostream>
#include <string_view>

#include <glm/geometric.hpp>

#include "examples/picture.h"
#include "nav/motion/path_follower.h"
#include "nav/planning/grid_planner.h"

using namespace segsim;

namespace {

constexpr std::array<std::string_view, 14> kFloorPlan = {
    "################################",  //
    "#..............#...............#",  //
    "#..............#...............#",  //
    "#..S...........#...............#",  //
    "#..............................#",  //
    "#..............................#",  //
    "#..............................#",  //
    "#..............................#",  //
    "#..............#...............#",  //
    "#..............#########.......#",  //
    "#..............#...............#",  //
    "#..............#...G...........#",  //
    "#..............#...............#",  //
    "################################"};
constexpr double kLetter_m = 0.25;
constexpr double kCell_m = 0.05;
constexpr int kCellsPerLetter = 5;

char letter_at(const nav::Cell& cell) {
  return kFloorPlan[kFloorPlan.size() - 1 - static_cast<std::size_t>(cell.y / kCellsPerLetter)]
                   [static_cast<std::size_t>(cell.x / kCellsPerLetter)];
}

/// Centre of the only square with this letter.
glm::dvec2 place_of(char letter) {
  for (std::size_t row = 0; row < kFloorPlan.size(); ++row) {
    const std::size_t column = kFloorPlan[row].find(letter);
    if (column == std::string_view::npos) continue;
    return glm::dvec2(static_cast<double>(column) + 0.5,
                      static_cast<double>(kFloorPlan.size() - row) - 0.5) *
           kLetter_m;
  }
  throw std::logic_error("the floor plan lacks a letter");
}

nav::CostMap make_cost_map(double robot_radius_m) {
  const nav::GridFrame frame{
      .resolution_m = kCell_m,
      .width_cells = static_cast<int>(kFloorPlan.front().size()) * kCellsPerLetter,
      .height_cells = static_cast<int>(kFloorPlan.size()) * kCellsPerLetter};
  core::Image<nav::CellState> states(frame.width_cells, frame.height_cells,
                                     nav::CellState::kFree);
  for (int y = 0; y < frame.height_cells; ++y) {
    for (int x = 0; x < frame.width_cells; ++x) {
      if (letter_at({x, y}) == '#') states(x, y) = nav::CellState::kOccupied;
    }
  }
  nav::CostMap map;
  map.build(frame, states, {}, {.robot_radius_m = robot_radius_m});
  return map;
}

core::Image<core::Rgb8> picture_of(const nav::CostMap& map) {
  core::Image<core::Rgb8> image(map.frame().width_cells, map.frame().height_cells);
  for (int y = 0; y < image.height_px(); ++y) {
    for (int x = 0; x < image.width_px(); ++x) {
      const std::uint8_t grey = map.traversable({x, y})                          ? 255
                                : map.state({x, y}) == nav::CellState::kOccupied ? 0
                                                                                 : 170;
      examples::paint(image, {x, y}, 0, {grey, grey, grey});
    }
  }
  return image;
}

}  // namespace

int main() {
  constexpr double kPeriod_s = 0.1;
  const nav::CostMap map = make_cost_map(0.33);
  const auto path = nav::plan_path(map, place_of('S'), place_of('G'));
  if (!path) {
    std::cerr << "there is no way from S to G\n";
    return 1;
  }
  core::Image<core::Rgb8> image = picture_of(map);
  for (std::size_t i = 1; i < path->points_m.size(); ++i) {
    for (double part = 0.0; part <= 1.0; part += 0.01) {
      examples::paint(
          image, map.frame().cell_at(glm::mix(path->points_m[i - 1], path->points_m[i], part)),
          1, {40, 90, 255});
    }
  }

  nav::PathFollower follower;
  follower.set_path(*path);
  core::Pose2 pose{path->points_m.front().x, path->points_m.front().y, 0.0};
  double driven_m = 0.0, time_s = 0.0;
  double nearest_wall_m = nav::CostMap::kReach_m;
  while (!follower.arrived(pose) && time_s < 120.0) {
    const core::VelocityCommand command = follower.follow(pose, map);
    pose = nav::advance(pose, command, kPeriod_s);
    driven_m += command.forward_mps * kPeriod_s;
    time_s += kPeriod_s;
    const nav::Cell cell = map.frame().cell_at({pose.x_m, pose.y_m});
    nearest_wall_m = std::min(nearest_wall_m, static_cast<double>(map.clearance_m(cell)));
    examples::paint(image, cell, 0, {230, 30, 30});
  }
  examples::write_ppm("map.ppm", image);
  std::cout << "straight_m " << glm::distance(place_of('S'), place_of('G')) << "\nplanned_m "
            << path->length_m << "\ndriven_m " << driven_m << "\ntime_s " << time_s
            << "\nnearest_wall_m " << nearest_wall_m << "\narrived " << follower.arrived(pose)
            << '\n';
  return follower.arrived(pose) ? 0 : 1;
}
