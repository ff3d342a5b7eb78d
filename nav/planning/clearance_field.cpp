#include "nav/planning/clearance_field.h"

#include <algorithm>

#include "core/check.h"

namespace segsim::nav {
namespace {

constexpr std::int16_t kNone = 11'000;  // Any square beyond the largest reach; sums still fit.

/// steps[x] = 0 at a source, else one more than in the row before, up to `most`.
void next_row_steps(const std::uint8_t* __restrict sources, std::int16_t* __restrict steps,
                    int count, std::int16_t most) {
  for (int x = 0; x < count; ++x) {
    const auto more = static_cast<std::int16_t>(std::min<int>(steps[x] + 1, most));
    steps[x] = sources[x] != 0 ? std::int16_t{0} : more;
  }
}

void to_squares(const std::int16_t* __restrict steps, std::int16_t* __restrict squares,
                int count, int reach) {
  for (int x = 0; x < count; ++x) {
    const std::int16_t s = steps[x];
    squares[x] = s > reach ? kNone : static_cast<std::int16_t>(s * s);
  }
}

/// best[x] = the smaller of best[x] and others[x] + more.
void take_smaller(std::int16_t* __restrict best, const std::int16_t* __restrict others,
                  std::int16_t more, int count) {
  for (int x = 0; x < count; ++x) {
    const auto other = static_cast<std::int16_t>(others[x] + more);
    best[x] = other < best[x] ? other : best[x];
  }
}

}  // namespace

void ClearanceField::reset(int width_cells, int height_cells, int reach_cells) {
  SEGSIM_CHECK(reach_cells >= 1 && reach_cells <= 100, "reach_cells");
  reach_ = reach_cells;
  squares_.reset(width_cells, height_cells, beyond());
}

void ClearanceField::update(const GridView<std::uint8_t>& sources, const CellBox& changed) {
  const CellBox all{Cell(0), Cell(squares_.width_cells() - 1, squares_.height_cells() - 1)};
  const CellBox out = changed.grown(reach_).clipped_to(all);
  if (!out.empty()) compute(sources, out);
}

void ClearanceField::compute(const GridView<std::uint8_t>& sources, const CellBox& out) {
  SEGSIM_CHECK(same_size(sources, squares_), "sources and field differ in size");
  const CellBox all{Cell(0), Cell(squares_.width_cells() - 1, squares_.height_cells() - 1)};
  const CellBox in = out.grown(reach_).clipped_to(all);

  // Along columns: the nearest source above or below, for the columns that matter.
  const int width = in.width(), left = out.low.x - in.low.x;
  const auto most = static_cast<std::int16_t>(reach_ + 1);
  const auto stride = static_cast<std::size_t>(width);
  column_squares_.resize(stride * static_cast<std::size_t>(out.height()));
  std::vector<std::int16_t> steps(stride, most), squares(stride);
  const auto row_of = [&](int j) {
    return column_squares_.data() + stride * static_cast<std::size_t>(j - out.low.y);
  };
  for (int j = in.low.y; j <= out.high.y; ++j) {
    next_row_steps(sources.row(j) + in.low.x, steps.data(), width, most);
    if (j >= out.low.y) to_squares(steps.data(), row_of(j), width, reach_);
  }
  std::fill(steps.begin(), steps.end(), most);
  for (int j = in.high.y; j >= out.low.y; --j) {
    next_row_steps(sources.row(j) + in.low.x, steps.data(), width, most);
    if (j > out.high.y) continue;
    to_squares(steps.data(), squares.data(), width, reach_);
    take_smaller(row_of(j), squares.data(), 0, width);
  }

  // Along rows: the best of the columns within reach.
  const std::int16_t far = beyond();
  const auto farthest = static_cast<std::int16_t>(reach_ * reach_);
  for (int j = out.low.y; j <= out.high.y; ++j) {
    const std::int16_t* columns = row_of(j);
    std::int16_t* result = squares_.row(j) + out.low.x;
    const int count = out.width();
    std::copy_n(columns + left, count, result);
    for (int k = 1; k <= reach_; ++k) {
      const auto k2 = static_cast<std::int16_t>(k * k);
      // Cells whose neighbour k columns away lies inside.
      const int from_left = std::max(0, k - left);
      take_smaller(result + from_left, columns + left + from_left - k, k2, count - from_left);
      take_smaller(result, columns + left + k, k2, std::min(count, width - left - k));
    }
    for (int x = 0; x < count; ++x) {
      if (result[x] > farthest) result[x] = far;
    }
  }
}

}  // namespace segsim::nav
