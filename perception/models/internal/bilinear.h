#pragma once

/// @file
/// Numbers of a network's output grid, read between the middles of its cells.

#include <algorithm>

namespace segsim::perception {

/// Row by row. Borrowed.
struct FloatGrid {
  const float* values;
  int width, height;
};

/// @param x, y  In cells; the middle of the first one is (0, 0). The border goes on outside.
[[nodiscard]] inline float bilinear(const FloatGrid& grid, double x, double y) {
  const auto split = [](double at, int n, int& low, int& high) {
    at = std::clamp(at, 0.0, static_cast<double>(n - 1));
    low = static_cast<int>(at);
    high = std::min(low + 1, n - 1);
    return static_cast<float>(at - low);
  };
  int x0 = 0, x1 = 0, y0 = 0, y1 = 0;
  const float fx = split(x, grid.width, x0, x1), fy = split(y, grid.height, y0, y1);
  const auto at = [&](int px, int py) { return grid.values[py * grid.width + px]; };
  const float above = at(x0, y0) * (1 - fx) + at(x1, y0) * fx;
  const float below = at(x0, y1) * (1 - fx) + at(x1, y1) * fx;
  return above * (1 - fy) + below * fy;
}

}  // namespace segsim::perception
