/// What one image changes in the map of nav/mapping/occupancy_map.h.

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "nav/mapping/depth_cleanup.h"
#include "nav/mapping/occupancy_map.h"

namespace segsim::nav {
namespace {

constexpr double kMaxStartFree_m = 2.0;  // Bound of the assumed-free disc.
constexpr float kOverhang_m = 0.25F;     // Floor may be seen below what hangs higher.
constexpr float kSureOdds = 1.2F;        // Two hits more than misses.

}  // namespace

/// Whether a known obstacle stands on the ray before `range_m`.
bool OccupancyMap::hidden_by_obstacle(const MappingCamera& camera, const glm::dvec3& direction,
                                      double range_m) const {
  const double planar = std::hypot(direction.x, direction.y), r = frame_.resolution_m;
  for (double s = 0.0; s < range_m - 0.5 * r; s += r) {
    const glm::dvec3 p = camera.eye_m + direction * (s / planar);
    const Cell cell = frame_.cell_at(glm::dvec2(p));
    if (obstacles_(cell.x, cell.y) == 0) continue;
    const HitHeights& stored = heights_(cell.x, cell.y);
    const double low_m = 2.0 * r;
    if (body_(cell.x, cell.y) > options_.occupied_above &&
        p.z < static_cast<double>(stored.body_top_m) + low_m) {
      return true;
    }
    if (mast_(cell.x, cell.y) > options_.occupied_above &&
        p.z > static_cast<double>(stored.mast_low_m) - low_m &&
        p.z < static_cast<double>(stored.mast_top_m) + low_m) {
      return true;
    }
  }
  return false;
}

/// Pixels without depth that should show the floor.
void OccupancyMap::note_holes(const core::Image<float>& depth_m, const MappingCamera& camera) {
  if (options_.hole_views <= 0) return;
  for (int y = 0; y < depth_m.height_px(); ++y) {
    for (int x = 0; x < depth_m.width_px(); x += options_.ray_step_x_px) {
      if (depth_m(x, y) > 0.0F) continue;
      const glm::dvec3 direction = camera.direction(x + 0.5, y + 0.5);
      if (direction.z > -1e-3) continue;
      const double range_m =
          camera.eye_m.z / -direction.z * std::hypot(direction.x, direction.y);
      if (range_m > std::min(options_.hole_range_m, options_.max_range_m)) continue;
      const glm::dvec3 p = camera.eye_m + direction * (camera.eye_m.z / -direction.z);
      const Cell cell = frame_.cell_at(glm::dvec2(p));
      if (body_(cell.x, cell.y) != 0.0F) continue;
      const std::size_t index = view_.index(cell);
      if (view_.has(index, ViewCells::kHole)) continue;
      if (!hidden_by_obstacle(camera, direction, range_m)) view_.mark_hole(index);
    }
  }
}

void OccupancyMap::fuse_hole(const Cell& at, const CellView& cell) {
  if (body_(at.x, at.y) != 0.0F || cell.hits.body > 0 || cell.hits.mast > 0) return;
  std::uint8_t& views = hole_views_(at.x, at.y);
  if (++views >= options_.hole_views) body_(at.x, at.y) = kAssumedFree;
}

void OccupancyMap::fuse_body(const Cell& at, const CellView& cell, int hits_needed,
                             bool below_unseen, HitHeights& stored) {
  float& odds = body_(at.x, at.y);
  if (odds >= kBlocked) return;
  if (cell.hits.body >= hits_needed) {
    odds = std::min(odds + options_.log_odds_hit, options_.log_odds_max);
    stored.body_low_m = std::min(stored.body_low_m, cell.hits.heights.body_low_m);
    stored.body_top_m = std::max(stored.body_top_m, cell.hits.heights.body_top_m);
  } else if (below_unseen && cell.hits.mast >= hits_needed && odds > 2.0F * kAssumedFree) {
    // Near the robot only the upper part of a wall is in view. Take it to stand on the floor
    // unless that cell was seen to be free before.
    odds = std::min(odds + options_.log_odds_hit, options_.log_odds_max);
    stored.body_low_m = static_cast<float>(options_.obstacle_min_m);
    stored.body_top_m = static_cast<float>(options_.obstacle_max_m);
  } else if (cell.hits.body == 0) {  // A single point says neither this nor that.
    const bool occupied = odds > options_.occupied_above;
    const bool floor_instead = cell.floor_hits >= options_.min_hits_per_cell &&
                               (stored.body_low_m < kOverhang_m || odds < kSureOdds);
    const bool miss = occupied ? cell.through_body || floor_instead : cell.passed_low;
    if (!miss) return;
    odds = std::max(odds - options_.log_odds_miss, options_.log_odds_min);
    if (odds < options_.free_below) {
      stored.body_low_m = HitHeights{}.body_low_m;
      stored.body_top_m = HitHeights{}.body_top_m;
    }
  }
}

void OccupancyMap::fuse_mast(const Cell& at, const CellView& cell, int hits_needed,
                             HitHeights& stored) {
  float& odds = mast_(at.x, at.y);
  if (odds >= kBlocked) return;
  if (cell.hits.mast >= hits_needed) {
    odds = std::min(odds + options_.log_odds_hit, options_.log_odds_max);
    stored.mast_low_m = std::min(stored.mast_low_m, cell.hits.heights.mast_low_m);
    stored.mast_top_m = std::max(stored.mast_top_m, cell.hits.heights.mast_top_m);
  } else if (cell.hits.mast == 0 && cell.through_mast) {
    odds = std::max(odds - options_.log_odds_miss, options_.log_odds_min);
    if (odds < options_.free_below) {
      stored.mast_low_m = HitHeights{}.mast_low_m;
      stored.mast_top_m = HitHeights{}.mast_top_m;
    }
  }
}

void OccupancyMap::fuse_view(const MappingCamera& camera) {
  const glm::dvec2 eye(camera.eye_m);
  // Nearer than this the body band lies below the image.
  const double blind_m = camera.range_where_lowest_ray_is_at(options_.obstacle_max_m);
  // Pixels of a facing square of one cell at 1 m; the number falls with the distance squared.
  const double square_px = options_.hit_share * frame_.resolution_m * frame_.resolution_m *
                           camera.intrinsics.fx_px * camera.intrinsics.fy_px;
  CellBox changed, observed;
  const auto fuse_cell = [&](const Cell& at, std::size_t seen_index) {
    const CellView cell{view_.hits(seen_index), view_.floor_hits(seen_index),
                        view_.has(seen_index, ViewCells::kPassedLow),
                        view_.has(seen_index, ViewCells::kThroughBody),
                        view_.has(seen_index, ViewCells::kThroughMast)};
    bool below_unseen = false;
    int hits_needed = options_.min_hits_per_cell;
    if (cell.hits.mast > 0 || cell.hits.body > 0) {
      const glm::dvec2 offset = frame_.center_m(at) - eye;
      const double range2 = glm::dot(offset, offset);
      below_unseen =
          cell.hits.mast > 0 && range2 < blind_m * blind_m && like_a_wall(cell.hits.heights);
      // Nearer than 1 m the camera looks over what it hits at a slant.
      hits_needed = std::max(hits_needed, static_cast<int>(square_px / std::max(range2, 1.0)));
    }
    std::uint8_t& obstacle = obstacles_(at.x, at.y);
    HitHeights heights = obstacle != 0 ? heights_(at.x, at.y) : HitHeights{};
    fuse_body(at, cell, hits_needed, below_unseen, heights);
    fuse_mast(at, cell, hits_needed, heights);
    if (view_.has(seen_index, ViewCells::kHole)) fuse_hole(at, cell);
    obstacle = heights.any() ? 1 : 0;
    if (obstacle != 0) heights_(at.x, at.y) = heights;
    changed.add(at);
    if (body_(at.x, at.y) != 0.0F) observed.add(at);
  };
  view_.for_each_told(fuse_cell);
  const Cell lattice = frame_.lattice();
  if (!changed.empty()) changed_.add(CellBox{changed.low + lattice, changed.high + lattice});
  if (!observed.empty())
    observed_.add(CellBox{observed.low + lattice, observed.high + lattice});
}

void OccupancyMap::integrate(const core::Observation& observation) {
  SEGSIM_CHECK(observation.depth_m != nullptr, "observation without depth");
  const core::Image<float>& depth_m = *observation.depth_m;
  SEGSIM_CHECK(depth_m.width_px() == observation.intrinsics.width_px &&
                   depth_m.height_px() == observation.intrinsics.height_px,
               "depth image and intrinsics differ in size");
  const int n = thinning_of(depth_m);
  if (n == 1) {
    fuse_image(depth_m, MappingCamera(observation));
  } else {
    core::Observation thinned = observation;
    thinned.intrinsics = thinned_camera(observation.intrinsics, n);
    thin_out(depth_m, n, thinned_m_);
    fuse_image(thinned_m_, MappingCamera(thinned));
  }
}

void OccupancyMap::fuse_image(const core::Image<float>& depth_m, const MappingCamera& camera) {
  const glm::dvec2 robot(camera.robot_m), eye(camera.eye_m);

  const double reach_m = options_.max_range_m + 4.0 * frame_.resolution_m;
  if (!ensure_covers(glm::min(robot, eye) - reach_m, glm::max(robot, eye) + reach_m)) return;
  if (!started_) {
    const double blind_m = camera.range_where_lowest_ray_is_at(options_.pass_height_m);
    assume_free_disc(robot, options_.start_free_radius_m > 0.0
                                ? options_.start_free_radius_m
                                : std::min(blind_m + 0.1, kMaxStartFree_m));
    started_ = true;
  }

  view_.open(frame_, obstacles_, camera,
             {options_.obstacle_min_m, options_.obstacle_max_m,
              camera.eye_m.z + options_.mast_above_camera_m, options_.max_range_m,
              options_.pass_height_m, options_.reject_flying_pixels});
  view_.mark_end_points(depth_m, camera);
  // Of large images, about 128 x 64 rays.
  view_.trace_rays(depth_m, camera, heights_,
                   std::max(options_.ray_step_x_px, (depth_m.width_px() + 64) / 128),
                   std::max(options_.ray_step_y_px, (depth_m.height_px() + 32) / 64));
  note_holes(depth_m, camera);
  fuse_view(camera);

  // The inscribed circle is free for certain; the ring around it only where nothing was seen.
  mark_free_disc(robot, options_.inside_radius_m);
  assume_free_disc(robot, std::max(options_.near_free_radius_m, options_.footprint_radius_m));
}

}  // namespace segsim::nav
