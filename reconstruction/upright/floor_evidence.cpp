#include "reconstruction/upright/floor_evidence.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

namespace segsim::reconstruction {
namespace {

constexpr double kLevel = 0.95, kUpright = 0.3;  // Cosines of a normal with up.
constexpr double kBand_m = 0.06;                 // Above and below a plane.
constexpr double kApart_m = 0.15;                // Between planes.
constexpr double kSmallestPlane_m2 = 0.15;
/// A plane this large compared with the largest is a floor wherever walls end; a smaller one
/// only if they end at it.
constexpr double kLargeShare = 0.25;
constexpr double kLowestCamera_m = 0.25, kHighestCamera_m = 2.5;
constexpr double kFewestCameras = 0.05;  // Share that stands above a floor.
constexpr double kColumn_m = 0.3;        // Walls are told apart by columns of this width.
constexpr double kTallWall_m = 0.4;
/// Share of the walls that pass a table or a landing, and not a floor: a staircase passes too,
/// but on one side only.
constexpr double kMostPassing = 0.35;
constexpr double kAgreement = 0.25;  // Share of the walls that end where a floor is guessed.

using Cell = std::pair<std::int64_t, std::int64_t>;

Cell cell_of(const glm::dvec3& p_m, double size_m) {
  return {static_cast<std::int64_t>(std::floor(p_m.x / size_m)),
          static_cast<std::int64_t>(std::floor(p_m.y / size_m))};
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct LevelPlane {
  double height_m = 0.0, area_m2 = 0.0;
};

/// Level surfaces that are seen from above, ascending.
std::vector<LevelPlane> level_planes(std::span<const SurfaceElement> elements) {
  std::vector<const SurfaceElement*> left;
  for (const SurfaceElement& e : elements) {
    if (e.normal.z > kLevel) left.push_back(&e);
  }
  std::sort(left.begin(), left.end(), [](const SurfaceElement* a, const SurfaceElement* b) {
    return a->position_m.z < b->position_m.z;
  });
  std::vector<LevelPlane> planes;
  while (!left.empty()) {
    // The band of 2 kBand_m that holds the most.
    std::size_t best = 0, most = 0;
    for (std::size_t first = 0, end = 0; first < left.size(); ++first) {
      const double top_m = left[first]->position_m.z + 2.0 * kBand_m;
      while (end < left.size() && left[end]->position_m.z <= top_m) ++end;
      if (end - first > most) most = end - first, best = first;
    }
    std::vector<double> heights_m;
    std::set<Cell> cells;
    for (std::size_t i = best; i < best + most; ++i) {
      heights_m.push_back(left[i]->position_m.z);
      cells.insert(cell_of(left[i]->position_m, kElement_m));
    }
    const LevelPlane plane{median(std::move(heights_m)),
                           static_cast<double>(cells.size()) * kElement_m * kElement_m};
    if (plane.area_m2 < kSmallestPlane_m2) break;
    planes.push_back(plane);
    std::erase_if(left, [&](const SurfaceElement* e) {
      return std::abs(e->position_m.z - plane.height_m) < kApart_m;
    });
  }
  std::sort(planes.begin(), planes.end(),
            [](const auto& a, const auto& b) { return a.height_m < b.height_m; });
  return planes;
}

/// Lower ends of the tall columns of wall.
std::vector<double> wall_ends(std::span<const SurfaceElement> elements) {
  std::map<Cell, std::vector<double>> columns;
  for (const SurfaceElement& e : elements) {
    if (std::abs(e.normal.z) < kUpright) {
      columns[cell_of(e.position_m, kColumn_m)].push_back(e.position_m.z);
    }
  }
  std::vector<double> ends_m;
  for (auto& [cell, heights_m] : columns) {
    std::sort(heights_m.begin(), heights_m.end());
    if (heights_m.back() - heights_m.front() > kTallWall_m)
      ends_m.push_back(heights_m.front());
  }
  std::sort(ends_m.begin(), ends_m.end());
  return ends_m;
}

/// Share of ascending `values` in [from, to].
double share_within(const std::vector<double>& values, double from, double to) {
  if (values.empty()) return 0.0;
  const auto first = std::lower_bound(values.begin(), values.end(), from);
  const auto last = std::upper_bound(first, values.end(), to);
  return static_cast<double>(last - first) / static_cast<double>(values.size());
}

/// Heights of cameras and ends of walls, ascending.
struct Surroundings {
  std::vector<double> cameras_m, ends_m;

  [[nodiscard]] double standing_above(double height_m) const {
    return share_within(cameras_m, height_m + kLowestCamera_m, height_m + kHighestCamera_m);
  }
  [[nodiscard]] double passing(double height_m) const {
    return share_within(ends_m, -1e9, height_m - 0.2);
  }
  /// Walls end a little above the floor: no patch is flat in the corner.
  [[nodiscard]] double ending_at(double height_m) const {
    return share_within(ends_m, height_m - 0.1, height_m + 0.3);
  }
};

std::optional<FloorEvidence> seen_floor(const std::vector<LevelPlane>& planes,
                                        const Surroundings& around) {
  double largest_m2 = 0.0;
  for (const LevelPlane& plane : planes) {
    if (around.standing_above(plane.height_m) < kFewestCameras) continue;
    largest_m2 = std::max(largest_m2, plane.area_m2);
  }
  for (const LevelPlane& plane : planes) {
    const double cameras = around.standing_above(plane.height_m);
    const double ending = around.ending_at(plane.height_m);
    if (cameras < kFewestCameras || around.passing(plane.height_m) > kMostPassing) continue;
    const bool large = plane.area_m2 >= kLargeShare * largest_m2;
    if (!large && ending < kAgreement) continue;
    return FloorEvidence{plane.height_m, false, plane.area_m2, cameras, ending};
  }
  return std::nullopt;
}

/// The height, below the cameras, within 6 cm of which the most walls end, if hardly any
/// passes it.
std::optional<FloorEvidence> guessed_floor(const Surroundings& around) {
  constexpr double kNear_m = 0.06, kMostBelow = 0.1;
  constexpr std::size_t kFewestWalls = 8;
  if (around.ends_m.size() < kFewestWalls) return std::nullopt;
  std::optional<FloorEvidence> best;
  for (const double end_m : around.ends_m) {
    const double ending = share_within(around.ends_m, end_m - kNear_m, end_m + kNear_m);
    const double cameras = around.standing_above(end_m);
    if (ending < kAgreement || cameras < 0.5 || around.passing(end_m) > kMostBelow) continue;
    if (!best || ending > best->wall_share)
      best = FloorEvidence{end_m, true, 0.0, cameras, ending};
  }
  return best;
}

}  // namespace

std::optional<FloorEvidence> find_floor_evidence(std::span<const SurfaceElement> elements,
                                                 std::span<const double> camera_heights_m) {
  Surroundings around;
  around.ends_m = wall_ends(elements);
  around.cameras_m.assign(camera_heights_m.begin(), camera_heights_m.end());
  std::sort(around.cameras_m.begin(), around.cameras_m.end());
  const auto seen = seen_floor(level_planes(elements), around);
  return seen ? seen : guessed_floor(around);
}

}  // namespace segsim::reconstruction
