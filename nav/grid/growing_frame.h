#pragma once

/// @file
/// Bounds of the maps of a search: they grow with what is seen, up to a limit that bounds
/// their memory, or stay fixed with indices that wrap, as in VLFM (quirk Q9).
///
/// A side that has to grow gets half of the map's length more, so that it happens rarely.

#include <algorithm>
#include <optional>

#include "nav/grid/grid.h"

namespace segsim::nav {

struct GrowthOptions {
  double resolution_m = 0.05;    ///< VLFM: 20 cells per metre.
  double start_extent_m = 12.0;  ///< Side of the first square, around the first pose.
  double step_m = 4.0;           ///< Growth per side is a multiple of this and
  double growth_share = 0.5;     ///< at least this share of the length, while it fits.
  double max_extent_m = 200.0;   ///< No side gets longer: 16 million cells.
  bool wrap = false;             ///< Fixed square of `start_extent_m`; Q9 as published.
  bool centered_cells = false;  ///< Cell centres, not corners, on multiples of the resolution.
};

/// VLFM's square: 1000 x 1000 cells, the start in the middle of cell (500, 500).
[[nodiscard]] inline GrowthOptions published_square() {
  GrowthOptions options;
  options.start_extent_m = 50.0;
  options.wrap = true;
  options.centered_cells = true;
  return options;
}

/// A frame whose first square lies around `center_m`.
[[nodiscard]] inline GridFrame first_frame(const GrowthOptions& options,
                                           const glm::dvec2& center_m) {
  GridFrame frame;
  const double r = options.resolution_m;
  frame.resolution_m = r;
  const int cells = static_cast<int>(std::lround(options.start_extent_m / r));
  frame.width_cells = frame.height_cells = cells;
  const glm::dvec2 middle = glm::floor(center_m / r + 0.5);
  const int half = cells / 2;
  frame.origin_m = (middle - glm::dvec2(half)) * r;
  if (options.centered_cells) frame.origin_m -= glm::dvec2(0.5 * r);
  return frame;
}

/// Grows the frame until it covers the box, as far as the limit allows.
/// @return  What was added; nullopt if the box does not fit (the frame then stays as it is).
[[nodiscard]] inline std::optional<Margins> grow(GridFrame& frame,
                                                 const GrowthOptions& options,
                                                 const glm::dvec2& low_m,
                                                 const glm::dvec2& high_m) {
  const double r = frame.resolution_m;
  const int step = std::max(1, static_cast<int>(std::lround(options.step_m / r)));
  const int limit = static_cast<int>(options.max_extent_m / r);
  // In metres first: far away there are more cells than an int counts.
  const glm::dvec2 most_m =
      glm::max(high_m, frame.origin_m + r * glm::dvec2(frame.width_cells, frame.height_cells));
  const glm::dvec2 least_m = glm::min(low_m, frame.origin_m);
  const glm::dvec2 span_m = most_m - least_m;
  if (!(span_m.x <= options.max_extent_m + 2.0 * options.step_m &&
        span_m.y <= options.max_extent_m + 2.0 * options.step_m)) {
    return std::nullopt;
  }
  const Cell low = frame.cell_at(low_m), high = frame.cell_at(high_m);
  const Cell missing_low = -low;
  const Cell missing_high(high.x - frame.width_cells + 1, high.y - frame.height_cells + 1);
  // Both sides of one direction; generously, or as little as it takes.
  const auto added = [&](int before, int after, int length) {
    const auto cells = [&](int missing, double least) {
      const int wanted = std::max(missing, static_cast<int>(least));
      return missing > 0 ? (wanted + step - 1) / step * step : 0;
    };
    const double least = options.growth_share * length;
    const Cell generous(cells(before, least), cells(after, least));
    if (length + generous.x + generous.y <= limit) return generous;
    return Cell(cells(before, 0.0), cells(after, 0.0));
  };
  const Cell x = added(missing_low.x, missing_high.x, frame.width_cells);
  const Cell y = added(missing_low.y, missing_high.y, frame.height_cells);
  const Margins margins{x.x, y.x, x.y, y.y};
  if (!margins.any()) return margins;
  const int width = frame.width_cells + margins.left + margins.right;
  const int height = frame.height_cells + margins.bottom + margins.top;
  if (options.wrap || width > limit || height > limit) return std::nullopt;
  frame.origin_m -= glm::dvec2(margins.left, margins.bottom) * r;
  frame.width_cells = width;
  frame.height_cells = height;
  return margins;
}

/// The cell as NumPy would index it: negative ones count from the end (once), others beyond
/// the end are an error, here nullopt.
[[nodiscard]] inline std::optional<Cell> wrapped(const GridFrame& frame, Cell cell) {
  if (cell.x < 0) cell.x += frame.width_cells;
  if (cell.y < 0) cell.y += frame.height_cells;
  if (!frame.contains(cell)) return std::nullopt;
  return cell;
}

}  // namespace segsim::nav
