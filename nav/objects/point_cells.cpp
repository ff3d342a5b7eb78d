#include <algorithm>
#include <numeric>

#include <glm/common.hpp>

#include "core/check.h"
#include "nav/objects/internal/point_cells.h"

namespace segsim::nav::internal {
namespace {

struct Offset {
  std::int64_t dx, dy;
};
/// Of the columns: the nearest first, which hold most neighbours; nine touch the middle one.
constexpr std::array<Offset, PointCells::kColumns> kOffsets{
    {{0, 0},  {0, -1}, {0, 1},  {-1, 0},  {1, 0},   {-1, -1}, {-1, 1}, {1, -1}, {1, 1},
     {0, -2}, {0, 2},  {-2, 0}, {2, 0},   {-1, -2}, {-1, 2},  {1, -2}, {1, 2},  {-2, -1},
     {-2, 1}, {2, -1}, {2, 1},  {-2, -2}, {-2, 2},  {2, -2},  {2, 2}}};

/// Sorts positions by their keys, which stay in order of the positions among equals: two bytes
/// at a time, from the lowest on. @param keys  Of positions 0, 1, ...; sorted, too.
std::vector<std::uint32_t> sort_by_key(std::vector<std::uint64_t>& keys) {
  constexpr int kBits = 11;
  constexpr std::size_t kDigits = std::size_t{1} << kBits;
  std::vector<std::uint32_t> order(keys.size()), next_order(keys.size());
  std::vector<std::uint64_t> next_keys(keys.size());
  std::iota(order.begin(), order.end(), std::uint32_t{0});
  const std::uint64_t most = *std::max_element(keys.begin(), keys.end());
  for (int shift = 0; shift < 64 && most >> shift != 0; shift += kBits) {
    const auto digit = [&](std::uint64_t key) { return (key >> shift) & (kDigits - 1); };
    std::array<std::uint32_t, kDigits> at{};
    for (const std::uint64_t key : keys) ++at[digit(key)];
    std::exclusive_scan(at.begin(), at.end(), at.begin(), std::uint32_t{0});
    for (std::size_t k = 0; k < keys.size(); ++k) {
      const std::uint32_t to = at[digit(keys[k])]++;
      next_keys[to] = keys[k];
      next_order[to] = order[k];
    }
    keys.swap(next_keys);
    order.swap(next_order);
  }
  return order;
}

}  // namespace

PointCells::PointCells(const std::vector<glm::vec3>& points, double side_m)
    : x_m_(points.size()), y_m_(points.size()), z_m_(points.size()) {
  glm::vec3 low = points.front(), high = low;
  for (const glm::vec3& p : points) {
    low = glm::min(low, p);
    high = glm::max(high, p);
  }
  const glm::dvec3 from(low), per_cell(1.0 / side_m);
  // Two cells are left on each side, so that a neighbour's key never is that of a cell in
  // another row.
  const glm::dvec3 span = (glm::dvec3(high) - from) * per_cell + 5.0;
  SEGSIM_CHECK(span.x * span.y * span.z < 9e18, "points too far apart for eps_m");
  const auto per_y = static_cast<std::int64_t>(span.z);
  const std::int64_t per_x = static_cast<std::int64_t>(span.y) * per_y;
  std::vector<std::uint64_t> keys(points.size());
  for (std::size_t k = 0; k < points.size(); ++k) {
    const glm::dvec3 cell = (glm::dvec3(points[k]) - from) * per_cell + 2.0;
    keys[k] = static_cast<std::uint64_t>(static_cast<std::int64_t>(cell.x) * per_x +
                                         static_cast<std::int64_t>(cell.y) * per_y +
                                         static_cast<std::int64_t>(cell.z));
  }
  members_ = sort_by_key(keys);
  for (std::size_t k = 0; k < keys.size(); ++k) {
    if (keys_.empty() || keys_.back() != keys[k]) {
      keys_.push_back(keys[k]);
      first_.push_back(static_cast<std::uint32_t>(k));
    }
    const glm::vec3& point = points[members_[k]];
    x_m_[k] = point.x;
    y_m_[k] = point.y;
    z_m_[k] = point.z;
  }
  first_.push_back(static_cast<std::uint32_t>(points.size()));
  for (std::size_t column = 0; column < kColumns; ++column) {
    const auto [dx, dy] = kOffsets[column];
    steps_[column] = static_cast<std::uint64_t>(dx * per_x + dy * per_y);
  }
  find_neighbours();
}

/// For each column around a cell, one sweep over the sorted cells finds the neighbours of all
/// of them.
void PointCells::find_neighbours() {
  neighbours_.resize(count() * kColumns);
  const auto cells = static_cast<std::uint32_t>(count());
  for (std::size_t column = 0; column < kColumns; ++column) {
    std::uint32_t begin = 0, end = 0;
    for (std::uint32_t c = 0; c < cells; ++c) {
      const std::uint64_t middle = keys_[c] + steps_[column];
      while (begin < cells && keys_[begin] + 2 < middle) ++begin;
      end = std::max(begin, end);
      while (end < cells && keys_[end] <= middle + 2) ++end;
      neighbours_[c * kColumns + column] = {begin, end};
    }
  }
}

}  // namespace segsim::nav::internal
