#pragma once

/// @file
/// Distance of every cell to the nearest source cell, exact up to a reach and kept up to date
/// where sources change: a changed cell says nothing about cells farther away than the reach.
///
/// Two passes over whole rows of 16-bit squares, after Felzenszwalb and Huttenlocher 2012
/// (their lower envelope replaced by the few columns within reach, which vectorises).

#include <cstdint>
#include <vector>

#include "nav/grid/grid_layer.h"

namespace segsim::nav {

class ClearanceField {
 public:
  /// No source anywhere. @param reach_cells  In [1, 100].
  void reset(int width_cells, int height_cells, int reach_cells);
  /// Adds cells without sources around the old ones.
  void grow(const Margins& added) { squares_.grow(added); }
  /// To be called after sources changed: computes their cells anew, and the reach around them.
  /// @param changed  Holds every changed cell; may go beyond the image.
  void update(const GridView<std::uint8_t>& sources, const CellBox& changed);
  /// Computes these cells anew; inside of the image.
  void compute(const GridView<std::uint8_t>& sources, const CellBox& out);

  /// Squared distance between cell centres [cells^2]; beyond() if it is larger than the reach.
  [[nodiscard]] std::int16_t squared_cells(int x, int y) const { return squares_(x, y); }
  [[nodiscard]] const std::int16_t* row(int y) const { return squares_.row(y); }
  [[nodiscard]] std::int16_t beyond() const {
    return static_cast<std::int16_t>(reach_ * reach_ + 1);
  }
  [[nodiscard]] int reach_cells() const { return reach_; }

 private:
  int reach_ = 1;
  GridLayer<std::int16_t> squares_;
  std::vector<std::int16_t> column_squares_;  ///< Scratch: squared distances along columns.
};

}  // namespace segsim::nav
