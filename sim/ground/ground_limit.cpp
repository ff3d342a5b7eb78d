#include "sim/ground/ground_limit.h"

#include "core/error.h"
#include "core/formatted.h"
#include "core/input/bounds.h"

namespace segsim::sim {

void require_ground_cells(double cells_x, double cells_y, const std::string& place) {
  if (cells_x * cells_y <= core::kMostGroundCells) return;  // False for NaN, too.
  throw core::InputError::expected(
      place, core::print("a ground of at most %.0f cells", core::kMostGroundCells),
      core::print("%.0f x %.0f", cells_x, cells_y));
}

}  // namespace segsim::sim
