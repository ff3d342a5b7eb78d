#pragma once

/// @file
/// Points of a cloud in the cells of a grid, for searches in the near.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <glm/vec3.hpp>

namespace segsim::nav::internal {

/// Points sorted into cells, and cells by (x, y, z); neighbours lie at most two cells away.
/// Points are named by their position in that order here.
class PointCells {
 public:
  static constexpr std::size_t kColumns = 25;
  /// Positions next to one another in an order.
  struct Range {
    std::uint32_t begin = 0, end = 0;
  };

  /// @param points  Not empty. @param side_m  Of a cell.
  PointCells(const std::vector<glm::vec3>& points, double side_m);
  [[nodiscard]] std::size_t count() const { return keys_.size(); }
  /// Points of a cell.
  [[nodiscard]] Range points_of(std::size_t c) const { return {first_[c], first_[c + 1]}; }
  /// Points of cells next to one another.
  [[nodiscard]] Range points_of(const Range& cells) const {
    return {first_[cells.begin], first_[cells.end]};
  }
  /// Which point of those that were given.
  [[nodiscard]] std::uint32_t given(std::uint32_t point) const { return members_[point]; }
  /// Cells that may hold neighbours, the cell itself among them, column by column.
  [[nodiscard]] std::span<const Range, kColumns> neighbours(std::size_t c) const {
    return std::span<const Range, kColumns>(neighbours_.data() + c * kColumns, kColumns);
  }
  /// Those of a column that touch the cell, if only by a corner.
  [[nodiscard]] Range beside(std::size_t c, std::size_t column) const {
    if (column >= kColumnsBeside) return {};
    Range range = neighbours(c)[column];
    const std::uint64_t middle = keys_[c] + steps_[column];
    while (range.begin < range.end && keys_[range.begin] + 1 < middle) ++range.begin;
    while (range.begin < range.end && keys_[range.end - 1] > middle + 1) --range.end;
    return range;
  }
  [[nodiscard]] double distance2_m2(std::uint32_t a, std::uint32_t b) const {
    const double dx = static_cast<double>(x_m_[a]) - static_cast<double>(x_m_[b]);
    const double dy = static_cast<double>(y_m_[a]) - static_cast<double>(y_m_[b]);
    const double dz = static_cast<double>(z_m_[a]) - static_cast<double>(z_m_[b]);
    return dx * dx + dy * dy + dz * dz;
  }
  /// How many points of a range lie within a distance of a point. In floats, of which twice as
  /// many go into a register, and with doubles only where floats may be wrong. The loop has no
  /// branch, so that it vectorises.
  [[nodiscard]] [[gnu::always_inline]] std::uint32_t count_near(const Range& points,
                                                                std::uint32_t point,
                                                                double most2_m2) const {
    constexpr float kRounding = 1e-6F;
    const float *xs = x_m_.data(), *ys = y_m_.data(), *zs = z_m_.data();
    const float px = xs[point], py = ys[point], pz = zs[point];
    const float surely = static_cast<float>(most2_m2) * (1.0F - kRounding);
    const float perhaps = static_cast<float>(most2_m2) * (1.0F + kRounding);
    std::int32_t near = 0, possible = 0;
    for (std::uint32_t k = points.begin; k < points.end; ++k) {
      const float dx = px - xs[k], dy = py - ys[k], dz = pz - zs[k];
      const float d2 = dx * dx + dy * dy + dz * dz;
      near += d2 <= surely ? 1 : 0;
      possible += d2 <= perhaps ? 1 : 0;
    }
    if (near != possible) {
      near = 0;
      for (std::uint32_t k = points.begin; k < points.end; ++k) {
        near += distance2_m2(point, k) <= most2_m2 ? 1 : 0;
      }
    }
    return static_cast<std::uint32_t>(near);
  }

 private:
  static constexpr std::size_t kColumnsBeside = 9;  // The first ones.

  void find_neighbours();

  std::vector<std::uint64_t> keys_;              // Of each cell; they ascend.
  std::vector<std::uint32_t> members_;           // The points in their order,
  std::vector<float> x_m_, y_m_, z_m_;           // where they lie,
  std::vector<std::uint32_t> first_;             // and the first one of each cell.
  std::array<std::uint64_t, kColumns> steps_{};  // From a key to that of another column.
  std::vector<Range> neighbours_;
};

}  // namespace segsim::nav::internal
