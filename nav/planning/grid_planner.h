#pragma once

/// @file
/// Shortest paths on the cost map: A* (8 neighbours, octile heuristic) and the Dijkstra field
/// from the robot that frontier choice needs. The cost of a step is its length times the mean
/// of the two cells' CostMap::length_cost.

#include <limits>
#include <optional>
#include <vector>

#include "core/check.h"
#include "nav/planning/cost_map.h"

namespace segsim::nav {

/// What a way to a cell costs to which none leads.
inline constexpr float kUnreachable_m = std::numeric_limits<float>::infinity();

struct Path {
  std::vector<glm::dvec2> points_m;  ///< From the start to the goal, Odom.
  double length_m = 0.0;             ///< Euclidean, after shortening.
  double cost_m = 0.0;               ///< Weighted length on the grid, before shortening.
};

/// Distances from one cell over traversable cells, computed as far out as they are asked for:
/// which cells can be reached at all is known at once, row by row; the price of the nearest
/// ones is known before that of those farther away.
///
/// Buckets one cell wide take the place of a heap (Dial 1969); the sums are those of
/// Dijkstra's algorithm to the last bit. The map must outlive the field and stay as it is
/// meanwhile. Not for several threads at once.
class GeodesicField {
 public:
  /// Starts from a cell, or from the one by which it escapes from inflation.
  /// @return  False if there is none within 1 m; everything is unreachable then.
  bool begin(const CostMap& map, const Cell& from);
  /// Where the search began.
  [[nodiscard]] Cell start() const { return start_; }
  [[nodiscard]] bool reachable(const Cell& cell) const;
  /// 1 where reachable() holds. [width_cells x height_cells of the map]
  [[nodiscard]] const GridLayer<std::uint8_t>& reachable_cells() const { return reachable_; }
  /// Holds all reachable cells.
  [[nodiscard]] const CellBox& reachable_box() const { return box_; }
  /// Weighted by length_cost; infinity where unreachable.
  [[nodiscard]] float cost_m(int x, int y) const;
  /// Whether cost_m() of the cell is known without further search.
  [[nodiscard]] bool settled(const Cell& cell) const;
  /// All costs below this are known.
  [[nodiscard]] double settled_below_m() const;
  /// Searches on by about one cell. @return  False if everything reachable is settled.
  bool settle_more() const;
  /// The reachable cell with the least cost among those for which `wanted(cell)` holds, of
  /// equals the first row by row; nullopt if there is none. Searches no farther than to it.
  /// To be called before anything else is settled.
  template <class Wanted>
  [[nodiscard]] std::optional<Cell> nearest_of(const Wanted& wanted) const {
    SEGSIM_CHECK(next_bucket_ == 0, "costs that are settled are not looked at again");
    std::optional<std::uint32_t> best;
    const auto visit = [&](std::uint32_t index) {
      const float cost_m = cost_m_.plane()[index],
                  best_m = best ? cost_m_.plane()[*best] : 0.0F;
      const bool better = !best || cost_m < best_m || (cost_m == best_m && index < *best);
      if (better && wanted(cost_m_.cell_of(index))) best = index;
    };
    while (!best && settle_bucket(visit)) {
    }
    if (!best) return std::nullopt;
    return cost_m_.cell_of(*best);
  }

 private:
  /// Settles the next bucket and visits the indices of its cells, some of them repeatedly.
  template <class Visit>
  bool settle_bucket(const Visit& visit) const {
    if (waiting_ == 0) return false;
    while (buckets_[next_bucket_].empty()) ++next_bucket_;
    // Rounding may put a neighbour into the bucket that is being emptied: it is visited, too.
    // NOLINTNEXTLINE(modernize-loop-convert): the bucket grows while it is visited.
    for (std::size_t k = 0; k < buckets_[next_bucket_].size(); ++k) {
      const Waiting cell = buckets_[next_bucket_][k];
      --waiting_;
      // Unless a better way was found since.
      if (cost_m_.plane()[cell.index] == cell.cost_m) relax_around(cell.index);
    }
    for (const Waiting& cell : buckets_[next_bucket_]) {
      if (cost_m_.plane()[cell.index] == cell.cost_m) visit(cell.index);
    }
    buckets_[next_bucket_].clear();
    ++next_bucket_;
    return true;
  }
  void spread_rows();
  void relax_around(std::uint32_t from) const;
  [[nodiscard]] std::size_t bucket_of(float cost_m) const {
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(cost_m * per_bucket_));
  }

  /// A cell, by its index in the plane, and the cost for which it is listed.
  struct Waiting {
    float cost_m;
    std::uint32_t index;
  };

  const CostMap* map_ = nullptr;
  GridLayer<std::uint8_t> reachable_;  ///< 1 where cells are joined to the start.
  Cell start_{0};
  CellBox box_;
  float per_bucket_ = 20.0F;
  // What is computed on demand.
  mutable GridLayer<float> cost_m_;  ///< Final below settled_below_m(); else a bound.
  mutable std::vector<std::vector<Waiting>> buckets_;
  mutable std::size_t next_bucket_ = 0, waiting_ = 0;
};

/// What a search needs and may use again; indices are those of the map's layers.
struct PlannerMemory {
  GridLayer<float> cost;            ///< 0: none yet. Zero everywhere between searches.
  GridLayer<std::uint32_t> parent;  ///< Holds something where a cost is known.
  std::vector<std::uint32_t> touched;
  std::vector<std::uint64_t> open;  ///< Of the queue.
};

/// The traversable cell that is reached first from `from` through cells that are not occupied
/// (`from` itself if it is traversable); nullopt if none lies within `limit_m`.
[[nodiscard]] std::optional<Cell> nearest_traversable(const CostMap& map, const Cell& from,
                                                      double limit_m = 1.0);

/// Weighted distances to all cells; nullopt if the start cannot escape to a traversable cell.
[[nodiscard]] std::optional<GeodesicField> geodesic_field(const CostMap& map,
                                                          const Cell& from);

/// A* from the start (which may lie inside inflation: the path begins with the way out) to the
/// cell of the goal; nullopt if there is no way. The result is shortened by line of sight.
/// @param memory  Of an earlier search, for speed; may be null.
[[nodiscard]] std::optional<Path> plan_path(const CostMap& map, const glm::dvec2& start_odom_m,
                                            const glm::dvec2& goal_odom_m,
                                            PlannerMemory* memory = nullptr);

/// Cells of the cheapest path, both ends included; nullopt if there is none. Both ends must be
/// traversable.
[[nodiscard]] std::optional<std::vector<Cell>> astar_cells(const CostMap& map,
                                                           const Cell& start, const Cell& goal,
                                                           PlannerMemory* memory = nullptr);

/// Weighted cost of a chain of neighbouring cells [m].
[[nodiscard]] double chain_cost_m(const CostMap& map, const std::vector<Cell>& cells);

/// Whether every cell that the segment touches is traversable.
[[nodiscard]] bool segment_traversable(const CostMap& map, const glm::dvec2& a_m,
                                       const glm::dvec2& b_m);

}  // namespace segsim::nav
