#include "nav/vlfm/internal/seen_near.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

namespace segsim::nav::internal {
namespace {

constexpr double kCoarse_m = 0.25;  // What was looked at is kept in squares of this side.
constexpr double kNear_m = 2.5;     // VLFM's own idea of "near enough to confirm or refute".
constexpr double kReach_m = 2.0;    // A place stands for what lies this near to it.
constexpr double kLeast_m2 = 0.5;   // Less is not worth the way.
constexpr double kWay_m2_per_m = 0.1;  // A metre of way outweighs this much.
constexpr int kRays = 64;
constexpr int kStride_cells = 5;  // Of candidate places.

using CoarseCell = std::pair<int, int>;

std::uint64_t key_of(const CoarseCell& cell) {
  return static_cast<std::uint64_t>(static_cast<std::uint32_t>(cell.first)) << 32 |
         static_cast<std::uint32_t>(cell.second);
}

CoarseCell coarse(const glm::dvec2& p_m) {
  return {static_cast<int>(std::floor(p_m.x / kCoarse_m)),
          static_cast<int>(std::floor(p_m.y / kCoarse_m))};
}

glm::dvec2 center_m(const CoarseCell& cell) {
  return {(cell.first + 0.5) * kCoarse_m, (cell.second + 0.5) * kCoarse_m};
}

}  // namespace

/// Along rays as far as the columns of the image see, up to kNear_m.
void SeenNear::add(const Moment& now, std::span<const float> limits_m) {
  const core::CameraIntrinsics& camera = now.observation->intrinsics;
  const auto T = now.observation->T_odom_camera();
  const glm::dvec2 eye_m(T.translation_m());
  for (int ray = 0; ray < kRays && !limits_m.empty(); ++ray) {
    const auto column =
        static_cast<std::size_t>((ray + 0.5) / kRays * static_cast<double>(limits_m.size()));
    const double right = (static_cast<double>(column) + 0.5 - camera.cx_px) / camera.fx_px;
    const glm::dvec2 direction(T.rotation() * glm::dvec3(right, 0.0, 1.0));
    const double planar = glm::length(direction);
    if (planar < 1e-6) return;
    const double range_m = std::min(static_cast<double>(limits_m[column]) * planar, kNear_m);
    std::optional<CoarseCell> last;
    for (double s = 0.0; s <= range_m; s += 0.5 * kCoarse_m) {
      const CoarseCell cell = coarse(eye_m + direction / planar * s);
      if (cell != last) cells_.insert(key_of(cell));
      last = cell;
    }
  }
}

bool SeenNear::nothing_new_for(double duration_s, core::TimeNs time_ns) {
  if (!news_ns_ || cells_.size() > news_) {
    news_ = cells_.size();
    news_ns_ = time_ns;
  }
  return core::seconds(time_ns - *news_ns_) > duration_s;
}

/// Floor that was explored, though never from near.
std::vector<glm::dvec2> SeenNear::unseen_floor_m(const CostMap& map) const {
  const GridFrame& frame = map.frame();
  std::vector<glm::dvec2> unseen_m;
  const CoarseCell low = coarse(frame.center_m(map.active().low)),
                   high = coarse(frame.center_m(map.active().high));
  for (int y = low.second; y <= high.second; ++y) {
    for (int x = low.first; x <= high.first; ++x) {
      const glm::dvec2 place_m = center_m({x, y});
      if (cells_.count(key_of({x, y})) == 0 &&
          map.state(frame.cell_at(place_m)) == CellState::kFree) {
        unseen_m.push_back(place_m);
      }
    }
  }
  return unseen_m;
}

std::optional<glm::dvec2> SeenNear::place_to_look_from(
    const CostMap& map, const GeodesicField& field,
    const std::function<bool(const glm::dvec2&)>& visited) const {
  const std::vector<glm::dvec2> unseen_m = unseen_floor_m(map);
  const CellBox& box = map.active();
  std::optional<glm::dvec2> best;
  double best_worth = 0.0;
  for (int j = box.low.y; j <= box.high.y; j += kStride_cells) {
    for (int i = box.low.x; i <= box.high.x; i += kStride_cells) {
      const glm::dvec2 place_m = map.frame().center_m({i, j});
      if (!field.reachable({i, j}) || map.state({i, j}) != CellState::kFree ||
          visited(place_m)) {
        continue;
      }
      const auto count = std::count_if(
          unseen_m.begin(), unseen_m.end(),
          [&](const glm::dvec2& p) { return glm::distance(p, place_m) <= kReach_m; });
      const double area_m2 = static_cast<double>(count) * kCoarse_m * kCoarse_m;
      if (area_m2 < kLeast_m2 || area_m2 <= best_worth) continue;
      const double worth = area_m2 - kWay_m2_per_m * static_cast<double>(field.cost_m(i, j));
      if (best && worth <= best_worth) continue;
      best = place_m;
      best_worth = worth;
    }
  }
  return best;
}

}  // namespace segsim::nav::internal
