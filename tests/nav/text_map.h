#pragma once

/// @file
/// Maps drawn as text for tests: '#' occupied, '.' free, '?' unknown, 'm' free below a table
/// top. The first line is the highest j.

#include <string>
#include <vector>

#include "core/random.h"
#include "nav/planning/cost_map.h"

namespace segsim::nav::test {

/// Inflation of less than a cell and no soft cost, so that the text is the truth.
inline CostMapOptions thin_options() {
  CostMapOptions options;
  options.robot_radius_m = 0.01;
  options.margin_m = 0.0;
  options.mast_radius_m = 0.01;
  options.soft_distance_m = 0.0;
  options.soft_weight = 0.0;
  options.fill_pocket_m2 = 0.0;
  return options;
}

inline CostMap text_map(const std::vector<std::string>& lines, const CostMapOptions& options,
                        double resolution_m = 0.1) {
  GridFrame frame;
  frame.resolution_m = resolution_m;
  frame.width_cells = static_cast<int>(lines.front().size());
  frame.height_cells = static_cast<int>(lines.size());
  core::Image<CellState> states(frame.width_cells, frame.height_cells);
  core::Image<std::uint8_t> mast(frame.width_cells, frame.height_cells);
  for (int j = 0; j < frame.height_cells; ++j) {
    for (int i = 0; i < frame.width_cells; ++i) {
      const char c = lines[static_cast<std::size_t>(frame.height_cells - 1 - j)]
                          [static_cast<std::size_t>(i)];
      states(i, j) = c == '#'   ? CellState::kOccupied
                     : c == '?' ? CellState::kUnknown
                                : CellState::kFree;
      mast(i, j) = c == 'm' ? 1 : 0;
    }
  }
  CostMap map;
  map.build(frame, states, mast, options);
  return map;
}

/// Free cells with occupied ones sprinkled in.
inline CostMap random_map(int size, double occupied_share, std::uint64_t seed,
                          const CostMapOptions& options) {
  core::RandomStream random(seed, "random_map");
  std::vector<std::string> lines(static_cast<std::size_t>(size),
                                 std::string(static_cast<std::size_t>(size), '.'));
  for (std::string& line : lines) {
    for (char& c : line) c = random.chance(occupied_share) ? '#' : '.';
  }
  return text_map(lines, options);
}

}  // namespace segsim::nav::test
