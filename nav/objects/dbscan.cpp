#include "nav/objects/dbscan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>
#include <utility>

#include <glm/common.hpp>

#include "core/check.h"

namespace segsim::nav {
namespace {

/// Positions next to one another in an order.
struct Range {
  std::uint32_t begin = 0, end = 0;
};

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

/// Points sorted into cells, and cells by (x, y, z); neighbours lie at most two cells away.
/// Points are named by their position in that order here.
class Cells {
 public:
  static constexpr std::size_t kColumns = 25;

  Cells(const std::vector<glm::vec3>& points, double side_m)
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
    per_y_ = static_cast<std::int64_t>(span.z);
    per_x_ = static_cast<std::int64_t>(span.y) * per_y_;
    std::vector<std::uint64_t> keys(points.size());
    for (std::size_t k = 0; k < points.size(); ++k) {
      const glm::dvec3 cell = (glm::dvec3(points[k]) - from) * per_cell + 2.0;
      keys[k] = static_cast<std::uint64_t>(static_cast<std::int64_t>(cell.x) * per_x_ +
                                           static_cast<std::int64_t>(cell.y) * per_y_ +
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
    find_neighbours();
  }
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
  /// For each of 25 columns around a cell, one sweep over the sorted cells finds the
  /// neighbours of all of them. The nearest columns, which hold most of them, come first.
  void find_neighbours() {
    neighbours_.resize(count() * kColumns);
    const auto cells = static_cast<std::uint32_t>(count());
    std::size_t column = 0;
    for (const std::int64_t dx : {0, -1, 1, -2, 2}) {
      for (const std::int64_t dy : {0, -1, 1, -2, 2}) {
        std::uint32_t begin = 0, end = 0;
        for (std::uint32_t c = 0; c < cells; ++c) {
          const std::uint64_t middle =
              keys_[c] + static_cast<std::uint64_t>(dx * per_x_ + dy * per_y_);
          while (begin < cells && keys_[begin] + 2 < middle) ++begin;
          end = std::max(begin, end);
          while (end < cells && keys_[end] <= middle + 2) ++end;
          neighbours_[c * kColumns + column] = {begin, end};
        }
        ++column;
      }
    }
  }

  std::int64_t per_x_ = 0, per_y_ = 0;  // Of the keys.
  std::vector<std::uint64_t> keys_;     // Of each cell; they ascend.
  std::vector<std::uint32_t> members_;  // The points in their order,
  std::vector<float> x_m_, y_m_, z_m_;  // where they lie,
  std::vector<std::uint32_t> first_;    // and the first one of each cell.
  std::vector<Range> neighbours_;
};

/// Marks the core points.
[[gnu::always_inline]] inline void mark_cores(const Cells& cells, double eps2, int min_points,
                                              std::vector<std::uint8_t>& core) {
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
    std::array<Range, Cells::kColumns + 1> around;
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
}

void mark_cores_anywhere(const Cells& cells, double eps2, int min_points,
                         std::vector<std::uint8_t>& core) {
  mark_cores(cells, eps2, min_points, core);
}

#ifdef __x86_64__
[[gnu::target("avx2")]] void mark_cores_avx2(const Cells& cells, double eps2, int min_points,
                                             std::vector<std::uint8_t>& core) {
  mark_cores(cells, eps2, min_points, core);
}
#endif

/// Which points are core points.
std::vector<std::uint8_t> find_cores(std::size_t count, const Cells& cells, double eps2,
                                     int min_points) {
  std::vector<std::uint8_t> core(count, 0);
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx2")) {
    mark_cores_avx2(cells, eps2, min_points, core);
    return core;
  }
#endif
  mark_cores_anywhere(cells, eps2, min_points, core);
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
void join_cells(const Cells& cells, const std::vector<std::uint8_t>& core, double eps2,
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
  for (std::uint32_t a = 0; a < cells.count(); ++a) {
    for (const Range& column : cells.neighbours(a)) {
      for (std::uint32_t b = std::max(column.begin, a + 1); b < column.end; ++b) {
        if (groups.root(a) != groups.root(b) && touch(a, b)) groups.join(a, b);
      }
    }
  }
}

constexpr std::uint32_t kNoPoint = 0xFFFFFFFF;

/// Finds the clusters of border points: that of their nearest core point.
class Borders {
 public:
  Borders(const Cells& cells, const std::vector<std::uint8_t>& core, double eps2,
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
  const Cells& cells_;
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
  const Cells cells(points, eps_m / std::sqrt(3.0) * (1.0 - 1e-6));
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
