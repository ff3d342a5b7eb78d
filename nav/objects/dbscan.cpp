#include "nav/objects/dbscan.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>
#include <unordered_map>
#include <utility>

#include <glm/common.hpp>

#include "core/check.h"

namespace segsim::nav {
namespace {

/// Cells next to one another in their order: those of one column.
struct CellRange {
  std::uint32_t begin = 0, end = 0;
};

/// Points sorted into cells, and cells by (x, y, z); neighbours lie at most two cells away.
class Cells {
 public:
  static constexpr std::size_t kColumns = 25;

  Cells(const std::vector<glm::vec3>& points, double side_m)
      : members_(points.size()),
        x_m_(points.size()),
        y_m_(points.size()),
        z_m_(points.size()) {
    std::vector<std::pair<std::uint64_t, std::size_t>> keyed(points.size());
    for (std::size_t k = 0; k < points.size(); ++k) {
      keyed[k] = {key(glm::ivec3(glm::floor(glm::dvec3(points[k]) / side_m))), k};
    }
    std::sort(keyed.begin(), keyed.end());
    for (std::size_t k = 0; k < keyed.size(); ++k) {
      if (keys_.empty() || keys_.back() != keyed[k].first) {
        keys_.push_back(keyed[k].first);
        first_.push_back(k);
      }
      members_[k] = keyed[k].second;
      const glm::dvec3 point(points[members_[k]]);
      x_m_[k] = point.x;
      y_m_[k] = point.y;
      z_m_[k] = point.z;
    }
    first_.push_back(points.size());
    find_neighbours();
  }
  [[nodiscard]] std::size_t count() const { return keys_.size(); }
  /// Indices of points, ascending.
  [[nodiscard]] std::span<const std::size_t> members(std::size_t c) const {
    return {members_.data() + first_[c], first_[c + 1] - first_[c]};
  }
  /// Cells that may hold neighbours, the cell itself among them, column by column.
  [[nodiscard]] std::span<const CellRange, kColumns> neighbours(std::size_t c) const {
    return std::span<const CellRange, kColumns>(neighbours_.data() + c * kColumns, kColumns);
  }
  /// How many points of these cells lie within a distance of a point; the cells' points lie
  /// next to one another, and the loop has no branch, so that it vectorises.
  [[nodiscard]] std::size_t count_near(const CellRange& cells, const glm::vec3& point,
                                       double distance2_m2) const {
    const double px = point.x, py = point.y, pz = point.z;
    std::int64_t near = 0;
    for (std::size_t k = first_[cells.begin]; k < first_[cells.end]; ++k) {
      const double dx = px - x_m_[k], dy = py - y_m_[k], dz = pz - z_m_[k];
      near += dx * dx + dy * dy + dz * dz <= distance2_m2 ? 1 : 0;
    }
    return static_cast<std::size_t>(near);
  }

 private:
  static constexpr std::int64_t kPerX = std::int64_t{1} << 42, kPerY = std::int64_t{1} << 21;

  /// Ascends with x, then y, then z.
  static std::uint64_t key(const glm::ivec3& cell) {
    const auto part = [](int v) {
      return static_cast<std::uint64_t>(v + (1 << 20)) & 0x1FFFFF;
    };
    return part(cell.x) << 42 | part(cell.y) << 21 | part(cell.z);
  }
  /// For each of 25 columns around a cell, one sweep over the sorted cells finds the
  /// neighbours of all of them. The nearest columns, which hold most of them, come first.
  void find_neighbours() {
    neighbours_.resize(count() * kColumns);
    std::size_t column = 0;
    for (const std::int64_t dx : {0, -1, 1, -2, 2}) {
      for (const std::int64_t dy : {0, -1, 1, -2, 2}) {
        std::uint32_t begin = 0, end = 0;
        for (std::size_t c = 0; c < count(); ++c) {
          const std::uint64_t middle =
              keys_[c] + static_cast<std::uint64_t>(dx * kPerX + dy * kPerY);
          while (begin < count() && keys_[begin] + 2 < middle) ++begin;
          end = std::max(begin, end);
          while (end < count() && keys_[end] <= middle + 2) ++end;
          neighbours_[c * kColumns + column] = {begin, end};
        }
        ++column;
      }
    }
  }

  std::vector<std::uint64_t> keys_;  // Of each cell.
  std::vector<std::size_t> members_, first_;
  std::vector<double> x_m_, y_m_, z_m_;  // Of the members.
  std::vector<CellRange> neighbours_;
};

double distance2(const glm::vec3& a, const glm::vec3& b) {
  const glm::dvec3 d = glm::dvec3(a) - glm::dvec3(b);
  return d.x * d.x + d.y * d.y + d.z * d.z;
}

/// Which points are core points.
std::vector<std::uint8_t> find_cores(const std::vector<glm::vec3>& points, const Cells& cells,
                                     double eps2, int min_points) {
  std::vector<std::uint8_t> core(points.size(), 0);
  const auto enough = static_cast<std::size_t>(min_points);
  for (std::size_t c = 0; c < cells.count(); ++c) {
    // All of a cell are within eps of one another.
    const bool full = cells.members(c).size() >= enough;
    for (const std::size_t k : cells.members(c)) {
      std::size_t count = full ? enough : 0;
      for (const CellRange& column : cells.neighbours(c)) {
        if (count >= enough) break;
        count += cells.count_near(column, points[k], eps2);
      }
      core[k] = count >= enough ? 1 : 0;
    }
  }
  return core;
}

/// Union-find over cells.
class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), std::size_t{0});
  }
  std::size_t root(std::size_t c) {
    while (parent_[c] != c) c = parent_[c] = parent_[parent_[c]];
    return c;
  }
  void join(std::size_t a, std::size_t b) {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::size_t> parent_;
};

}  // namespace

std::vector<int> dbscan(const std::vector<glm::vec3>& points, double eps_m, int min_points) {
  SEGSIM_CHECK(eps_m > 0.0 && min_points > 0, "eps_m, min_points");
  std::vector<int> cluster(points.size(), -1);
  if (points.empty()) return cluster;
  const double eps2 = eps_m * eps_m;
  // A hair smaller, so that rounding cannot put two far points of a cell beyond eps.
  const Cells cells(points, eps_m / std::sqrt(3.0) * (1.0 - 1e-6));
  const std::vector<std::uint8_t> core = find_cores(points, cells, eps2, min_points);

  // Cells with core points that lie within eps of one another belong together.
  Groups groups(cells.count());
  const auto touch = [&](std::size_t a, std::size_t b) {
    for (const std::size_t k : cells.members(a)) {
      if (core[k] == 0) continue;
      for (const std::size_t n : cells.members(b)) {
        if (core[n] != 0 && distance2(points[k], points[n]) <= eps2) return true;
      }
    }
    return false;
  };
  for (std::size_t a = 0; a < cells.count(); ++a) {
    for (const CellRange& column : cells.neighbours(a)) {
      for (std::size_t b = std::max<std::size_t>(column.begin, a + 1); b < column.end; ++b) {
        if (groups.root(a) != groups.root(b) && touch(a, b)) groups.join(a, b);
      }
    }
  }
  std::vector<std::size_t> cell_of(points.size());
  for (std::size_t c = 0; c < cells.count(); ++c) {
    for (const std::size_t k : cells.members(c)) cell_of[k] = c;
  }
  std::unordered_map<std::size_t, int> number;
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (core[k] == 0) continue;
    const auto next = static_cast<int>(number.size());
    cluster[k] = number.try_emplace(groups.root(cell_of[k]), next).first->second;
  }
  // Border points.
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (core[k] != 0) continue;
    std::size_t best = points.size();
    double best2 = eps2;
    const auto look_into = [&](std::size_t c) {
      for (const std::size_t n : cells.members(c)) {
        if (core[n] == 0) continue;
        const double d2 = distance2(points[k], points[n]);
        if (d2 < best2 || (d2 == best2 && n < best)) {
          best2 = d2;
          best = n;
        }
      }
    };
    for (const CellRange& column : cells.neighbours(cell_of[k])) {
      for (std::size_t c = column.begin; c < column.end; ++c) look_into(c);
    }
    if (best != points.size()) cluster[k] = cluster[best];
  }
  return cluster;
}

std::vector<glm::vec3> largest_dbscan_cluster(const std::vector<glm::vec3>& points_m,
                                              double eps_m, int min_points) {
  const std::vector<int> cluster = dbscan(points_m, eps_m, min_points);
  std::vector<std::size_t> sizes;
  for (const int c : cluster) {
    if (c < 0) continue;
    sizes.resize(std::max(sizes.size(), static_cast<std::size_t>(c) + 1), 0);
    ++sizes[static_cast<std::size_t>(c)];
  }
  std::vector<glm::vec3> points;
  if (sizes.empty()) return points;
  const auto best =
      static_cast<int>(std::max_element(sizes.begin(), sizes.end()) - sizes.begin());
  for (std::size_t k = 0; k < points_m.size(); ++k) {
    if (cluster[k] == best) points.push_back(points_m[k]);
  }
  return points;
}

}  // namespace segsim::nav
