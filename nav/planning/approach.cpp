#include "nav/planning/approach.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include <glm/geometric.hpp>

namespace segsim::nav {
namespace {

constexpr std::size_t kMaxSightChecks = 400;
constexpr double kNearnessWeight =
    4.0;                              // A metre nearer to the object is worth this detour [m].
constexpr double kEdgeMargin = 0.95;  // Stay this share inside the image's lower edge.
constexpr int kSpreadStride_cells = 4;  // Candidates of spread_places.
constexpr double kMinSpread_m = 1.5;    // Places nearer to one another are one place.

struct Candidate {
  Cell cell;
  double to_object_m;
};

/// Candidates in order of the way there and of their nearness to the object, the first of
/// equals first. The field is searched only as far as the next one depends on it.
class CandidatesByCost {
 public:
  CandidatesByCost(const GeodesicField& field, const std::vector<Candidate>& candidates)
      : field_(field), candidates_(candidates), open_(candidates.size()) {
    std::iota(open_.begin(), open_.end(), std::size_t{0});
    for (const Candidate& candidate : candidates) {
      nearest_m_ = std::min(nearest_m_, candidate.to_object_m);
    }
  }
  /// nullptr after the last one.
  const Candidate* next() {
    while (!open_.empty() && (priced_.empty() || !(priced_.front().cost_m < least_open_m()))) {
      price_more();
    }
    if (priced_.empty()) return nullptr;
    std::pop_heap(priced_.begin(), priced_.end(), std::greater<>());
    const std::size_t index = priced_.back().index;
    priced_.pop_back();
    return &candidates_[index];
  }

 private:
  struct Priced {
    double cost_m;
    std::size_t index;
    // NOLINTNEXTLINE(modernize-use-nullptr): it means the 0 of <=>.
    auto operator<=>(const Priced&) const = default;
  };

  /// No candidate without a price costs less.
  [[nodiscard]] double least_open_m() const {
    constexpr double kRounding_m = 1e-4;
    return field_.settled_below_m() - kRounding_m + kNearnessWeight * nearest_m_;
  }
  void price_more() {
    constexpr double kStep_m = 0.25;
    const double until_m = field_.settled_below_m() + kStep_m;
    while (field_.settled_below_m() < until_m && field_.settle_more()) {
    }
    std::erase_if(open_, [&](std::size_t index) {
      const Candidate& candidate = candidates_[index];
      if (!field_.settled(candidate.cell)) return false;
      const double way_m =
          static_cast<double>(field_.cost_m(candidate.cell.x, candidate.cell.y));
      priced_.push_back({way_m + kNearnessWeight * candidate.to_object_m, index});
      std::push_heap(priced_.begin(), priced_.end(), std::greater<>());
      return true;
    });
  }

  const GeodesicField& field_;
  const std::vector<Candidate>& candidates_;
  std::vector<std::size_t> open_;  // Without a price, in their order.
  std::vector<Priced> priced_;     // A heap.
  double nearest_m_ = 1e18;
};

/// Cells of the object's cloud, without strays beyond the trimmed extent (as in
/// nearest_point_m()).
std::vector<Cell> cells_of(const CostMap& map, const MappedObject& object) {
  std::vector<Cell> cells;
  for (const glm::vec3& p : object.cloud_m) {
    if (p.x < object.low_m.x || p.y < object.low_m.y || p.x > object.high_m.x ||
        p.y > object.high_m.y) {
      continue;
    }
    const Cell cell = map.frame().cell_at({p.x, p.y});
    if (map.active().contains(cell)) cells.push_back(cell);
  }
  return cells;
}

/// Distances to the object's cells, in a part of the map that holds them all.
core::Image<float> distance_to_object_m(const CostMap& map, const std::vector<Cell>& object,
                                        const CellBox& part) {
  core::Image<std::uint8_t> cells(part.width(), part.height());
  for (const Cell& cell : object) cells(cell.x - part.low.x, cell.y - part.low.y) = 1;
  return distance_to_cells_m(cells, map.frame().resolution_m);
}

/// The first candidate in order of cost across open floor, else the first in sight at all.
std::optional<ApproachPlace> cheapest_in_sight(const CostMap& map, const GeodesicField& field,
                                               const MappedObject& object,
                                               const std::vector<Candidate>& candidates) {
  CandidatesByCost by_cost(field, candidates);
  // Neighbours see the same; look at every n-th when there are many.
  const std::size_t stride = 1 + candidates.size() / kMaxSightChecks;
  std::optional<ApproachPlace> in_sight;
  for (std::size_t k = 0; k < candidates.size(); ++k) {
    const Candidate* const candidate = by_cost.next();
    if (k % stride != 0) continue;
    const Cell& cell = candidate->cell;
    const glm::dvec2 place = map.frame().center_m(cell);
    const glm::dvec2 surface = object.nearest_point_m(place);
    if (!line_of_sight(map, place, surface)) continue;
    const bool open = open_floor(map, place, surface);
    if (open || !in_sight) {
      in_sight = ApproachPlace{place, candidate->to_object_m, true, open,
                               static_cast<double>(field.cost_m(cell.x, cell.y))};
    }
    if (open) break;
  }
  return in_sight;
}

}  // namespace

ApproachRange approach_range(const ApproachDistances& distances, double view_m,
                             bool from_afar) {
  constexpr double kLeastWidth_m = 0.2;
  ApproachRange range;
  range.limit_m = distances.limit_m - distances.arrival_m;
  range.min_m =
      std::max(distances.min_m, std::min(view_m, range.limit_m - distances.sight_limit_m));
  if (from_afar) range.min_m = std::max(range.min_m, distances.far_look_m);
  range.min_m = std::min(range.min_m, range.limit_m - kLeastWidth_m);
  range.max_m =
      std::min(std::max(distances.max_m, range.min_m + distances.width_m), range.limit_m);
  return range;
}

double view_distance_m(const core::Observation& observation, const MappedObject& object) {
  if (object.cloud_m.empty()) return 0.0;
  const auto T_odom_camera = observation.T_odom_camera();
  const core::CameraIntrinsics& camera = observation.intrinsics;
  const glm::dvec3 lowest =
      T_odom_camera.rotation() * camera.back_project({camera.cx_px, camera.height_px}, 1.0);
  if (lowest.z >= -1e-6) return 1e3;
  const double reach = std::hypot(lowest.x, lowest.y) / (kEdgeMargin * -lowest.z);
  const glm::dvec2 robot(observation.T_odom_robot.translation_m());
  const glm::dvec2 nearest = object.nearest_point_m(robot);
  const glm::dvec2 to_nearest = nearest - robot;
  const double norm = glm::length(to_nearest);
  const glm::dvec2 along = norm > 1e-6 ? to_nearest / norm : glm::dvec2(0.0);
  // Each point has a distance at which it meets the lowest ray; what lies behind the nearest
  // point lets the robot come nearer by as much.
  std::vector<double> needed_m;
  needed_m.reserve(object.cloud_m.size());
  for (const glm::vec3& p : object.cloud_m) {
    const double below_camera_m = T_odom_camera.translation_m().z - static_cast<double>(p.z);
    const double behind_m = std::max(0.0, glm::dot(glm::dvec2(p.x, p.y) - nearest, along));
    needed_m.push_back(std::max(0.0, below_camera_m * reach - behind_m));
  }
  const auto middle = needed_m.begin() + static_cast<std::ptrdiff_t>(needed_m.size() / 2);
  std::nth_element(needed_m.begin(), middle, needed_m.end());
  return *middle;
}

bool line_of_sight(const CostMap& map, const glm::dvec2& from_m, const glm::dvec2& to_m,
                   double skip_m) {
  const double length_m = glm::distance(from_m, to_m);
  const double step_m = 0.5 * map.frame().resolution_m;
  for (double s = 0.0; s < length_m - skip_m; s += step_m) {
    const Cell cell = map.frame().cell_at(from_m + (to_m - from_m) * (s / length_m));
    // Occupied in both layers: as high as the mast.
    if (map.state(cell) == CellState::kOccupied && map.mast_clearance_m(cell) <= 0.0F)
      return false;
  }
  return true;
}

bool open_floor(const CostMap& map, const glm::dvec2& from_m, const glm::dvec2& to_m,
                double skip_m) {
  const double length_m = glm::distance(from_m, to_m);
  const double step_m = 0.5 * map.frame().resolution_m;
  for (double s = 0.0; s < length_m - skip_m; s += step_m) {
    const Cell cell = map.frame().cell_at(from_m + (to_m - from_m) * (s / length_m));
    if (map.state(cell) == CellState::kOccupied) return false;
  }
  return true;
}

std::optional<ApproachPlace> choose_approach(const CostMap& map, const GeodesicField& field,
                                             const MappedObject& object, double min_m,
                                             double max_m, double limit_m) {
  const std::vector<Cell> object_cells = cells_of(map, object);
  CellBox part;
  for (const Cell& cell : object_cells) part.add(cell);
  // All that lies within the limit; the whole map if nothing there can be reached.
  const int reach = static_cast<int>(std::max(max_m, limit_m) / map.frame().resolution_m) + 2;
  std::vector<Candidate> preferred, allowed;
  constexpr double kNone_m = 1e18;
  Candidate nearest{{0, 0}, kNone_m};
  for (const bool everywhere : {false, true}) {
    if (!everywhere && part.empty()) continue;
    const CellBox window =
        everywhere ? map.active() : part.grown(reach).clipped_to(map.active());
    const core::Image<float> distance_m = distance_to_object_m(map, object_cells, window);
    for (int j = window.low.y; j <= window.high.y; ++j) {
      for (int i = window.low.x; i <= window.high.x; ++i) {
        if (!field.reachable({i, j})) continue;
        const Candidate candidate{
            {i, j}, static_cast<double>(distance_m(i - window.low.x, j - window.low.y))};
        if (candidate.to_object_m < nearest.to_object_m) nearest = candidate;
        const bool prefer = candidate.to_object_m >= min_m && candidate.to_object_m <= max_m;
        const bool allow =
            candidate.to_object_m >= 0.5 * min_m && candidate.to_object_m <= limit_m;
        if (prefer || allow) (prefer ? preferred : allowed).push_back(candidate);
      }
    }
    if (nearest.to_object_m <= limit_m) break;
    if (everywhere) break;
    preferred.clear();
    allowed.clear();
    nearest.to_object_m = kNone_m;
  }
  if (auto place = cheapest_in_sight(map, field, object, preferred)) return place;
  if (auto place = cheapest_in_sight(map, field, object, allowed)) return place;
  if (nearest.to_object_m >= kNone_m) return std::nullopt;
  const glm::dvec2 place = map.frame().center_m(nearest.cell);
  const glm::dvec2 surface = object.nearest_point_m(place);
  return ApproachPlace{place, nearest.to_object_m, line_of_sight(map, place, surface),
                       open_floor(map, place, surface),
                       static_cast<double>(field.cost_m(nearest.cell.x, nearest.cell.y))};
}

std::vector<glm::dvec2> spread_places(const CostMap& map, const GeodesicField& field,
                                      int count) {
  std::vector<glm::dvec2> candidates;
  for (int j = map.active().low.y; j <= map.active().high.y; j += kSpreadStride_cells) {
    for (int i = map.active().low.x; i <= map.active().high.x; i += kSpreadStride_cells) {
      if (field.reachable({i, j})) candidates.push_back(map.frame().center_m({i, j}));
    }
  }
  // Farthest point sampling from the robot on.
  std::vector<glm::dvec2> chosen{map.frame().center_m(field.start())};
  while (static_cast<int>(chosen.size()) <= count) {
    double best_m = kMinSpread_m;
    std::optional<glm::dvec2> best;
    for (const glm::dvec2& candidate : candidates) {
      double nearest_m = 1e18;
      for (const glm::dvec2& other : chosen) {
        nearest_m = std::min(nearest_m, glm::distance(candidate, other));
      }
      if (nearest_m > best_m) {
        best_m = nearest_m;
        best = candidate;
      }
    }
    if (!best) break;
    chosen.push_back(*best);
  }
  chosen.erase(chosen.begin());
  std::stable_sort(chosen.begin(), chosen.end(),
                   [&](const glm::dvec2& a, const glm::dvec2& b) {
                     const auto cost = [&](const glm::dvec2& place) {
                       const Cell cell = map.frame().cell_at(place);
                       return field.cost_m(cell.x, cell.y);
                     };
                     return cost(a) < cost(b);
                   });
  return chosen;
}

}  // namespace segsim::nav
