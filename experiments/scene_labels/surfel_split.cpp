#include "experiments/scene_labels/surfel_split.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numeric>
#include <queue>
#include <tuple>
#include <utility>

#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::experiments::scene_labels {
namespace {

/// Which surfels touch, by a grid whose cells are as wide as surfels reach.
class TouchGraph {
 public:
  TouchGraph(const SurfelSet& surfels, double gap_m)
      : surfels_(surfels),
        gap_m_(static_cast<float>(gap_m)),
        cell_m_(std::max(gap_m_ + 2.0F * kLargestRadius_m, 1e-3F)) {
    SEGSIM_CHECK(gap_m >= 0.0 && std::isfinite(gap_m), "gap_m");
    SEGSIM_CHECK(surfels.position_m.size() == surfels.radius_m.size(), "radii of surfels");
    for (std::size_t i = 0; i < surfels.position_m.size(); ++i) {
      cells_[cell_of(surfels.position_m[i])].push_back(i);
    }
  }

  /// visit(other, distance_m) for every surfel that surfel `i` touches.
  template <class Visit>
  void neighbors(std::size_t i, const Visit& visit) const {
    const glm::vec3& p = surfels_.position_m[i];
    const Cell at = cell_of(p);
    const float reach_m = gap_m_ + radius_m(i);
    for (int x = at[0] - 1; x <= at[0] + 1; ++x) {
      for (int y = at[1] - 1; y <= at[1] + 1; ++y) {
        for (int z = at[2] - 1; z <= at[2] + 1; ++z) {
          const auto cell = cells_.find({x, y, z});
          if (cell == cells_.end()) continue;
          for (const std::size_t other : cell->second) {
            const float distance_m = glm::distance(p, surfels_.position_m[other]);
            if (other != i && distance_m <= reach_m + radius_m(other)) {
              visit(other, static_cast<double>(distance_m));
            }
          }
        }
      }
    }
  }

 private:
  using Cell = std::array<int, 3>;

  [[nodiscard]] Cell cell_of(const glm::vec3& p_m) const {
    return {static_cast<int>(std::floor(p_m.x / cell_m_)),
            static_cast<int>(std::floor(p_m.y / cell_m_)),
            static_cast<int>(std::floor(p_m.z / cell_m_))};
  }
  [[nodiscard]] float radius_m(std::size_t i) const {
    return std::min(surfels_.radius_m[i], kLargestRadius_m);
  }

  const SurfelSet& surfels_;
  float gap_m_, cell_m_;
  std::map<Cell, std::vector<std::size_t>> cells_;
};

std::size_t nearest(const SurfelSet& surfels, const glm::dvec3& p_m) {
  std::size_t best = 0;
  double least_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < surfels.position_m.size(); ++i) {
    const double distance_m = glm::distance(glm::dvec3(surfels.position_m[i]), p_m);
    if (distance_m < least_m) std::tie(best, least_m) = std::pair(i, distance_m);
  }
  return best;
}

/// Of a crumb, by one of its surfels: the piece of the nearest surfel that is in no crumb.
int piece_beside(const SurfelSet& surfels, const std::vector<int>& piece, std::size_t crumb,
                 const std::vector<char>& is_crumb) {
  int best = 0;
  float least_m = std::numeric_limits<float>::infinity();
  for (std::size_t j = 0; j < piece.size(); ++j) {
    if (is_crumb[static_cast<std::size_t>(piece[j])] != 0) continue;
    const float distance_m = glm::distance(surfels.position_m[crumb], surfels.position_m[j]);
    if (distance_m < least_m) std::tie(best, least_m) = std::pair(piece[j], distance_m);
  }
  return best;
}

}  // namespace

std::vector<int> connected_pieces(const SurfelSet& surfels, double gap_m, double least_share) {
  const TouchGraph graph(surfels, gap_m);
  const std::size_t n = surfels.position_m.size();
  std::vector<int> piece(n, -1);
  std::vector<std::vector<std::size_t>> members;
  for (std::size_t start = 0; start < n; ++start) {
    if (piece[start] >= 0) continue;
    const int id = static_cast<int>(members.size());
    std::vector<std::size_t>& mine = members.emplace_back(1, start);
    piece[start] = id;
    for (std::size_t next = 0; next < mine.size(); ++next) {
      graph.neighbors(mine[next], [&](std::size_t other, double) {
        if (piece[other] >= 0) return;
        piece[other] = id;
        mine.push_back(other);
      });
    }
  }
  std::size_t largest = 0;
  for (const auto& mine : members) largest = std::max(largest, mine.size());
  std::vector<char> is_crumb(members.size(), 0);
  for (std::size_t k = 0; k < members.size(); ++k) {
    const auto size = static_cast<double>(members[k].size());
    is_crumb[k] = size < least_share * static_cast<double>(n) && members[k].size() < largest;
  }
  const std::vector<int> as_found = piece;
  for (std::size_t k = 0; k < members.size(); ++k) {
    if (is_crumb[k] == 0) continue;
    const int to = piece_beside(surfels, as_found, members[k].front(), is_crumb);
    for (const std::size_t i : members[k]) piece[i] = to;
  }
  // Numbers by size.
  std::vector<std::size_t> size(members.size(), 0), order(members.size());
  for (const int id : piece) ++size[static_cast<std::size_t>(id)];
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return size[a] > size[b]; });
  std::vector<int> rank(members.size());
  for (std::size_t k = 0; k < order.size(); ++k) rank[order[k]] = static_cast<int>(k);
  for (int& id : piece) id = rank[static_cast<std::size_t>(id)];
  return piece;
}

std::vector<int> nearest_seeds(const SurfelSet& surfels, double gap_m,
                               std::span<const Seed> seeds) {
  SEGSIM_CHECK(!seeds.empty(), "no seeds");
  const TouchGraph graph(surfels, gap_m);
  const std::size_t n = surfels.position_m.size();
  std::vector<double> distance_m(n, std::numeric_limits<double>::infinity());
  std::vector<int> part(n, -1);
  using Step = std::tuple<double, int, std::size_t>;  // Distance, part, surfel.
  std::priority_queue<Step, std::vector<Step>, std::greater<>> open;
  for (const Seed& seed : seeds) {
    if (n > 0) open.emplace(0.0, seed.part, nearest(surfels, seed.p_m));
  }
  while (!open.empty()) {
    const auto [so_far_m, by, at] = open.top();
    open.pop();
    if (part[at] >= 0) continue;
    part[at] = by;
    graph.neighbors(at, [&, far_m = so_far_m, who = by](std::size_t other, double step_m) {
      if (part[other] >= 0 || far_m + step_m >= distance_m[other]) return;
      distance_m[other] = far_m + step_m;
      open.emplace(distance_m[other], who, other);
    });
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (part[i] >= 0) continue;
    part[i] = std::min_element(seeds.begin(), seeds.end(), [&](const Seed& a, const Seed& b) {
                const glm::dvec3 p(surfels.position_m[i]);
                return glm::distance(p, a.p_m) < glm::distance(p, b.p_m);
              })->part;
  }
  return part;
}

}  // namespace segsim::experiments::scene_labels
