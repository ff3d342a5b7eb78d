#include "nav/objects/dbscan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>

#include "core/check.h"
#include "core/process/vector_clones.h"
#include "nav/objects/internal/point_cells.h"

namespace segsim::nav {
namespace {

using internal::PointCells;
using Range = PointCells::Range;

/// Which points are core points.
SEGSIM_VECTOR_CLONES
std::vector<std::uint8_t> find_cores(std::size_t count, const PointCells& cells, double eps2,
                                     int min_points) {
  std::vector<std::uint8_t> core(count, 0);
  const auto enough = static_cast<std::uint32_t>(min_points);
  for (std::size_t c = 0; c < cells.count(); ++c) {
    const Range own = cells.points_of(c);
    // All of a cell are within eps of one another.
    const std::uint32_t inside = own.end - own.begin;
    if (inside >= enough) {
      std::fill(core.begin() + own.begin, core.begin() + own.end, std::uint8_t{1});
      continue;
    }
    // The columns' points, with the cell's own left out.
    std::array<Range, PointCells::kColumns + 1> around;
    std::uint32_t possible = inside;
    std::size_t ranges = 0;
    const auto add = [&](const Range& points) {
      if (points.begin >= points.end) return;
      around[ranges++] = points;
      possible += points.end - points.begin;
    };
    for (const Range& column : cells.neighbours(c)) {
      const Range points = cells.points_of(column);
      const bool holds_own = points.begin <= own.begin && own.end <= points.end;
      add({points.begin, holds_own ? own.begin : points.end});
      if (holds_own) add({own.end, points.end});
    }
    if (possible < enough) continue;
    for (std::uint32_t k = own.begin; k < own.end; ++k) {
      std::uint32_t near = inside, left = possible - inside;
      for (std::size_t n = 0; n < ranges && near < enough && near + left >= enough; ++n) {
        near += cells.count_near(around[n], k, eps2);
        left -= around[n].end - around[n].begin;
      }
      core[k] = near >= enough ? 1 : 0;
    }
  }
  return core;
}

/// Union-find over cells.
class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), std::uint32_t{0});
  }
  std::uint32_t root(std::uint32_t c) {
    while (parent_[c] != c) c = parent_[c] = parent_[parent_[c]];
    return c;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

/// Joins cells with core points that lie within eps of one another.
void join_cells(const PointCells& cells, const std::vector<std::uint8_t>& core, double eps2,
                Groups& groups) {
  const auto touch = [&](std::uint32_t a, std::uint32_t b) {
    const Range in_a = cells.points_of(a), in_b = cells.points_of(b);
    for (std::uint32_t k = in_a.begin; k < in_a.end; ++k) {
      if (core[k] == 0) continue;
      for (std::uint32_t n = in_b.begin; n < in_b.end; ++n) {
        if (core[n] != 0 && cells.distance2_m2(k, n) <= eps2) return true;
      }
    }
    return false;
  };
  // Cells side by side come first: most of the others are joined by then.
  for (const bool beside : {true, false}) {
    for (std::size_t column = 0; column < PointCells::kColumns; ++column) {
      for (std::uint32_t a = 0; a < cells.count(); ++a) {
        const Range around = beside ? cells.beside(a, column) : cells.neighbours(a)[column];
        for (std::uint32_t b = std::max(around.begin, a + 1); b < around.end; ++b) {
          if (groups.root(a) != groups.root(b) && touch(a, b)) groups.join(a, b);
        }
      }
    }
  }
}

constexpr std::uint32_t kNoPoint = 0xFFFFFFFF;

/// Finds the clusters of border points: that of their nearest core point.
class Borders {
 public:
  Borders(const PointCells& cells, const std::vector<std::uint8_t>& core, double eps2,
          Groups& groups)
      : cells_(cells), core_(core), eps2_(eps2), root_(cells.count(), kNoPoint) {
    for (std::uint32_t c = 0; c < cells.count(); ++c) {
      const Range own = cells.points_of(c);
      const auto last = core.begin() + own.end;
      if (std::find(core.begin() + own.begin, last, 1) != last) root_[c] = groups.root(c);
    }
  }
  /// The root of a cell with core points; kNoPoint without.
  [[nodiscard]] std::uint32_t root_of(std::uint32_t c) const { return root_[c]; }
  /// Turns to the points of another cell.
  void look_around(std::uint32_t c) {
    core_cells_.clear();
    one_cluster_ = true;
    std::uint32_t only = kNoPoint;
    for (const Range& column : cells_.neighbours(c)) {
      for (std::uint32_t cell = column.begin; cell < column.end; ++cell) {
        if (root_[cell] == kNoPoint) continue;
        one_cluster_ = one_cluster_ && (only == kNoPoint || only == root_[cell]);
        only = root_[cell];
        core_cells_.push_back(cell);
      }
    }
  }
  /// The root of the cluster; kNoPoint for noise. Where all that may be meant belong to one
  /// cluster, any core point within eps decides.
  [[nodiscard]] std::uint32_t cluster_of(std::uint32_t point) const {
    std::uint32_t best = kNoPoint, root = kNoPoint;
    double best2 = eps2_;
    for (const std::uint32_t cell : core_cells_) {
      const Range points = cells_.points_of(cell);
      for (std::uint32_t n = points.begin; n < points.end; ++n) {
        if (core_[n] == 0) continue;
        const double d2 = cells_.distance2_m2(point, n);
        // Of equals the one that was given first.
        if (d2 < best2 ||
            (d2 == best2 && (best == kNoPoint || cells_.given(n) < cells_.given(best)))) {
          best2 = d2;
          best = n;
          root = root_[cell];
          if (one_cluster_) return root;
        }
      }
    }
    return root;
  }

 private:
  const PointCells& cells_;
  const std::vector<std::uint8_t>& core_;
  double eps2_;
  std::vector<std::uint32_t> root_;  // Of each cell.
  // Around the present cell: cells with core points.
  std::vector<std::uint32_t> core_cells_;
  bool one_cluster_ = true;
};

}  // namespace

std::vector<int> dbscan(const std::vector<glm::vec3>& points, double eps_m, int min_points) {
  SEGSIM_CHECK(eps_m > 0.0 && min_points > 0, "eps_m, min_points");
  std::vector<int> cluster(points.size(), -1);
  if (points.empty()) return cluster;
  const double eps2 = eps_m * eps_m;
  // A hair smaller, so that rounding cannot put two far points of a cell beyond eps.
  const PointCells cells(points, eps_m / std::sqrt(3.0) * (1.0 - 1e-6));
  const std::vector<std::uint8_t> core = find_cores(points.size(), cells, eps2, min_points);
  Groups groups(cells.count());
  join_cells(cells, core, eps2, groups);

  // By the points as they were given: the root cell of each, of border points, too.
  std::vector<std::uint32_t> root_of(points.size(), kNoPoint);
  std::vector<std::uint8_t> given_core(points.size(), 0);
  Borders borders(cells, core, eps2, groups);
  for (std::uint32_t c = 0; c < cells.count(); ++c) {
    const Range own = cells.points_of(c);
    bool looked_around = false;
    for (std::uint32_t k = own.begin; k < own.end; ++k) {
      const std::uint32_t given = cells.given(k);
      given_core[given] = core[k];
      if (core[k] != 0) {
        root_of[given] = borders.root_of(c);
        continue;
      }
      if (!looked_around) borders.look_around(c);
      looked_around = true;
      root_of[given] = borders.cluster_of(k);
    }
  }
  std::vector<int> number(cells.count(), -1);
  int next = 0;
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (given_core[k] != 0 && number[root_of[k]] < 0) number[root_of[k]] = next++;
  }
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (root_of[k] != kNoPoint) cluster[k] = number[root_of[k]];
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
