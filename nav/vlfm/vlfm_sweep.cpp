/// VLFM's explored area knows no depth: a corner that the sector covered counts as explored
/// although it was only seen from far away, or not at all. When no frontier is left, the fixed
/// rules visit such places and turn around there.

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "nav/vlfm/internal/vlfm_search.h"

namespace segsim::nav::internal {
namespace {

constexpr double kCoarse_m = 0.25;  // What was looked at is kept in squares of this side.
constexpr double kNear_m = 2.5;     // VLFM's own idea of "near enough to confirm or refute".
constexpr double kReach_m = 2.0;    // A place stands for what lies this near to it.
constexpr double kLeast_m2 = 0.5;   // Less is not worth the way.
constexpr double kWay_m2_per_m = 0.1;  // A metre of way outweighs this much.
constexpr double kNarrower_m = 0.01;   // The follower's circle, than the planner's.
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
void VlfmSearch::note_near_cells(const Now& now) {
  const std::span<const float> limits_m = values_.last_limits_m();
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
      if (cell != last) seen_near_.insert(key_of(cell));
      last = cell;
    }
  }
}

/// Nothing is left to do. The search goes on where the robot fits only just: beside a table
/// the full inflation encloses it.
/// @return  False if it did so with every inflation.
bool VlfmSearch::squeeze_through() {
  if (squeezes_ == options_.tight_radii_m.size() || options_.sweep_places <= 0) return false;
  // Where the planner leads the follower must dare to go.
  FollowerOptions narrow = options_.follower;
  narrow.footprint_radius_m =
      std::min(narrow.footprint_radius_m, options_.tight_radii_m[squeezes_] - kNarrower_m);
  follower_ = PathFollower(narrow);
  ++squeezes_;
  vetoed_m_.clear();
  if (squeezes_ == options_.tight_radii_m.size()) {
    // A touch blocks a disc ahead, which may close a gap that could be passed in its middle.
    obstacles_.forget_blocked();
    stuck_places_m_.clear();
  }
  swept_m_.clear();
  postponed_until_ns_ = 0;
  planned_ns_ = -1;
  chooser_.reset();
  // What was put off may be in view.
  sweep_spinning_ = true;
  turns_ = 0;
  spun_rad_ = 0.0;
  return true;
}

/// Whether the search goes in circles: it may have a goal in sight that no way leads to, or a
/// camera that measures nothing.
bool VlfmSearch::nothing_new(const Now& now) {
  if (options_.sweep_places <= 0) return false;
  if (!news_ns_ || seen_near_.size() > news_) {
    news_ = seen_near_.size();
    news_ns_ = now.time_ns;
  }
  return core::seconds(now.time_ns - *news_ns_) > options_.give_up_s;
}

/// The reachable place around which most was seen only from afar.
std::optional<glm::dvec2> VlfmSearch::next_sweep_place(const Now& now) {
  if (sweep_m_) return sweep_m_;
  if (sweeps_ >= options_.sweep_places) return std::nullopt;
  refresh_cost_map();
  if (!field_.begin(cost_, cost_.frame().cell_at(now.position_m))) return std::nullopt;
  // Floor that was explored, though never from near.
  const GridFrame& frame = cost_.frame();
  std::vector<glm::dvec2> far_m;
  const CellBox& box = cost_.active();
  const CoarseCell low = coarse(frame.center_m(box.low)),
                   high = coarse(frame.center_m(box.high));
  for (int y = low.second; y <= high.second; ++y) {
    for (int x = low.first; x <= high.first; ++x) {
      const glm::dvec2 place_m = center_m({x, y});
      if (seen_near_.count(key_of({x, y})) == 0 &&
          cost_.state(frame.cell_at(place_m)) == CellState::kFree) {
        far_m.push_back(place_m);
      }
    }
  }
  std::optional<glm::dvec2> best;
  double best_worth = 0.0;
  for (int j = box.low.y; j <= box.high.y; j += kStride_cells) {
    for (int i = box.low.x; i <= box.high.x; i += kStride_cells) {
      const glm::dvec2 place_m = frame.center_m({i, j});
      if (!field_.reachable({i, j}) || cost_.state({i, j}) != CellState::kFree ||
          swept(place_m)) {
        continue;
      }
      const auto count = std::count_if(far_m.begin(), far_m.end(), [&](const glm::dvec2& p) {
        return glm::distance(p, place_m) <= kReach_m;
      });
      const double area_m2 = static_cast<double>(count) * kCoarse_m * kCoarse_m;
      if (area_m2 < kLeast_m2 || area_m2 <= best_worth) continue;
      const double worth = area_m2 - kWay_m2_per_m * static_cast<double>(field_.cost_m(i, j));
      if (best && worth <= best_worth) continue;
      best = place_m;
      best_worth = worth;
    }
  }
  if (best) {
    ++sweeps_;
    sweep_m_ = best;
    swept_m_.push_back(*best);
    sweep_since_ns_ = now.time_ns;
  }
  return best;
}

bool VlfmSearch::swept(const glm::dvec2& place_m) const {
  return std::any_of(swept_m_.begin(), swept_m_.end(), [&](const glm::dvec2& other_m) {
    return glm::distance(other_m, place_m) < 0.5 * kReach_m;
  });
}

core::VelocityCommand VlfmSearch::sweep_to(const Now& now, const glm::dvec2& place_m) {
  constexpr double kPatience_s = 30.0;
  const bool late = core::seconds(now.time_ns - sweep_since_ns_) > kPatience_s;
  const bool arrived = glm::distance(place_m, now.position_m) <
                       options_.follower.goal_tolerance_m + 0.5 * options_.actions.forward_m;
  if (arrived || late) {
    sweep_m_.reset();
    sweep_spinning_ = arrived;
    turns_ = 0;
    spun_rad_ = 0.0;
    follower_.clear();
    return {};
  }
  const core::VelocityCommand command = drive(now, place_m, false);
  // No way there after all.
  const bool moving = follower_.has_path() || executor_.busy();
  if (!moving) sweep_m_.reset();
  return command;
}

core::VelocityCommand VlfmSearch::spin_for_sweep(const Now& now) {
  const core::PolicyMode mode = mode_;
  mode_ = core::PolicyMode::kInitialize;  // spin() ends by leaving it.
  const core::VelocityCommand command = spin(now);
  sweep_spinning_ = mode_ == core::PolicyMode::kInitialize;
  mode_ = mode;
  return command;
}

}  // namespace segsim::nav::internal
