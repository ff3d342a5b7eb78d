#include "nav/occupancy_map.h"

#include <algorithm>
#include <cmath>

#include <glm/mat3x3.hpp>

#include "core/check.h"
#include "nav/depth_cleanup.h"

namespace segsim::nav {
namespace {

constexpr double kGrowStep_m = 4.0;     // The map grows by whole steps.
constexpr float kBlocked = 100.0F;      // Log-odds of touched obstacles; no ray changes them.
constexpr float kAssumedFree = -0.2F;   // Free, but one hit makes it occupied.
constexpr double kFloorBelow_m = 0.20;  // Points deeper below the floor are wrong.
constexpr double kInscribedShare =
    0.65;                                // Inscribed over circumscribed radius (0.215 / 0.33).
constexpr double kMaxStartFree_m = 2.0;  // Bound of the assumed-free disc.
constexpr float kPassLow_m = 0.10F;      // A ray contradicts an obstacle from this far below
constexpr float kPassTop_m = 0.02F;      // its lowest hit to this far below its top.
constexpr float kOverhang_m = 0.25F;     // Floor may be seen below what hangs higher.
constexpr float kSureOdds = 1.2F;        // Two hits more than misses.

/// Calls `visit(i, j)` for the cells whose centres lie within the disc, inside the map.
template <class Visit>
void for_each_cell_in_disc(const GridFrame& frame, const glm::dvec2& center_m, double radius_m,
                           const Visit& visit) {
  const Cell low = frame.cell_at(center_m - radius_m);
  const Cell high = frame.cell_at(center_m + radius_m);
  for (int j = std::max(low.y, 0); j <= std::min(high.y, frame.height_cells - 1); ++j) {
    for (int i = std::max(low.x, 0); i <= std::min(high.x, frame.width_cells - 1); ++i) {
      const glm::dvec2 offset = frame.center_m({i, j}) - center_m;
      if (glm::dot(offset, offset) <= radius_m * radius_m) visit(i, j);
    }
  }
}

/// Whether a pixel lies on the blend between two surfaces along one image axis: strictly
/// between its neighbours, apart from both, while the surfaces beyond go on smoothly. On a
/// plane, however slanted, inverse depth is linear in the pixel, so all differences are equal.
bool blended(const float* depth, std::ptrdiff_t step) {
  const float d = depth[0], a = depth[-step], b = depth[step];
  if (!((d - a) * (b - d) > 0.0F)) return false;  // NaN too.
  if (std::abs(b - a) < 0.15F + 0.05F * d) return false;
  if (std::min(std::abs(d - a), std::abs(b - d)) < 0.03F + 0.01F * d) return false;
  const float inner = std::abs(1.0F / a - 1.0F / b);
  const float outer = std::abs(1.0F / depth[-2 * step] - 1.0F / a) +
                      std::abs(1.0F / b - 1.0F / depth[2 * step]);
  return !(outer >= 0.8F * inner);  // Holes next to it: no plane.
}

bool flying_pixel(const core::Image<float>& depth_m, int x, int y) {
  const int width = depth_m.width_px(), height = depth_m.height_px();
  const float* depth = depth_m.row(y) + x;
  return (x >= 2 && x + 2 < width && blended(depth, 1)) ||
         (y >= 2 && y + 2 < height && blended(depth, width));
}

/// What find_ends() needs besides the pixels; cells are those of the map.
struct EndLimits {
  float eye_x, eye_y;  ///< [cells]
  float eye_z, mast_z;
  float per_cell, range2;
  int side, first;  ///< Of the scratch window: its width, and the index of the map's origin.
};

/// Heights and cells (indices into the scratch window; -1: of no use) in which a row's pixels
/// end. Only selections, no branches, so that it vectorises.
void find_ends(const float* __restrict depths, const float* __restrict columns_x,
               const float* __restrict columns_y, const float* __restrict columns_z,
               const glm::vec3& row, const EndLimits& limits, std::size_t count,
               float* __restrict heights_m, std::int32_t* __restrict ends) {
  const float row_x = row.x, row_y = row.y, row_z = row.z;
  const EndLimits l = limits;
  const auto lowest_z = -static_cast<float>(kFloorBelow_m);
  for (std::size_t x = 0; x < count; ++x) {
    const float depth = depths[x];
    const float z = l.eye_z + depth * (columns_z[x] + row_z);
    const float dx = depth * (columns_x[x] + row_x) * l.per_cell;
    const float dy = depth * (columns_y[x] + row_y) * l.per_cell;
    // Each comparison is false for NaN.
    const int used = static_cast<int>(depth > 0.0F) & static_cast<int>(z <= l.mast_z) &
                     static_cast<int>(z >= lowest_z) &
                     static_cast<int>(dx * dx + dy * dy <= l.range2);
    // Inside the map, hence positive: truncation is floor.
    const auto i = static_cast<std::int32_t>(l.eye_x + (used != 0 ? dx : 0.0F));
    const auto j = static_cast<std::int32_t>(l.eye_y + (used != 0 ? dy : 0.0F));
    heights_m[x] = z;
    ends[x] = used != 0 ? j * l.side + i - l.first : -1;
  }
}

template <class Pixel>
core::Image<Pixel> grown(const core::Image<Pixel>& old, int left, int bottom, int width,
                         int height) {
  core::Image<Pixel> result(width, height);
  for (int j = 0; j < old.height_px(); ++j) {
    std::copy_n(old.row(j), old.width_px(), result.row(j + bottom) + left);
  }
  return result;
}

}  // namespace

/// The camera of one observation, with heights above the robot's floor.
struct OccupancyMap::View {
  core::CameraIntrinsics intrinsics;
  glm::dmat3 R_odom_camera{1.0};
  glm::dvec3 eye_m{0.0};  ///< Odom, z above the floor.
  glm::dvec2 robot_m{0.0};
  double mast_top_m = 0.0;
  double floor_z_m = 0.0;
  double blind_range_m = 0.0;  ///< Nearer than this the body band lies below the image.

  explicit View(const core::Observation& observation, const OccupancyOptions& options)
      : intrinsics(observation.intrinsics) {
    const auto T_odom_camera = observation.T_odom_camera();
    R_odom_camera = glm::mat3_cast(T_odom_camera.rotation());
    robot_m = glm::dvec2(observation.T_odom_robot.translation_m());
    floor_z_m = observation.T_odom_robot.translation_m().z;
    eye_m = T_odom_camera.translation_m();
    eye_m.z -= floor_z_m;
    mast_top_m = eye_m.z + options.mast_above_camera_m;
    blind_range_m = range_where_lowest_ray_is_at(options.obstacle_max_m);
  }
  [[nodiscard]] glm::dvec3 direction(double u_px, double v_px) const {
    return R_odom_camera * glm::dvec3((u_px - intrinsics.cx_px) / intrinsics.fx_px,
                                      (v_px - intrinsics.cy_px) / intrinsics.fy_px, 1.0);
  }
  /// Planar distance at which the image's bottom ray falls to a height; 0 if it starts below.
  [[nodiscard]] double range_where_lowest_ray_is_at(double height_m) const {
    const glm::dvec3 d = direction(intrinsics.cx_px, intrinsics.height_px);
    const double planar = std::hypot(d.x, d.y);
    if (eye_m.z <= height_m) return 0.0;
    return d.z < -1e-6 ? (eye_m.z - height_m) / -d.z * planar : 1e3;
  }
};

OccupancyMap::OccupancyMap(const OccupancyOptions& options) : options_(options) {
  SEGSIM_CHECK(options.resolution_m > 0.0, "resolution_m");
  SEGSIM_CHECK(options.obstacle_max_m > options.obstacle_min_m, "obstacle band is empty");
  SEGSIM_CHECK(options.max_range_m > 0.0, "max_range_m");
  SEGSIM_CHECK(options.ray_step_x_px > 0 && options.ray_step_y_px > 0, "ray step");
  SEGSIM_CHECK(options.log_odds_hit > options.occupied_above &&
                   -options.log_odds_miss < options.free_below,
               "one observation must decide an unknown cell");
  reset();
}

void OccupancyMap::reset() {
  frame_ = {};
  frame_.resolution_m = options_.resolution_m;
  body_ = mast_ = {};
  heights_ = {};
  hole_views_ = {};
  observed_ = changed_ = {};
  touched_.clear();
  seen_ = {};
  stamp_ = 0;
  started_ = exhausted_ = false;
}

bool OccupancyMap::ensure_covers(const glm::dvec2& low_m, const glm::dvec2& high_m) {
  const double r = frame_.resolution_m;
  const int step = static_cast<int>(std::ceil(kGrowStep_m / r));
  if (frame_.width_cells == 0) {
    // Corners on whole multiples of the resolution, so that equal poses give equal grids.
    frame_.origin_m = glm::floor(low_m / r) * r;
    const glm::dvec2 cells = glm::ceil((high_m - frame_.origin_m) / r) + 1.0;
    frame_.width_cells = static_cast<int>(cells.x);
    frame_.height_cells = static_cast<int>(cells.y);
    body_ = mast_ = core::Image<float>(frame_.width_cells, frame_.height_cells, 0.0F);
    heights_ = core::Image<Heights>(frame_.width_cells, frame_.height_cells);
    hole_views_ = core::Image<std::uint8_t>(frame_.width_cells, frame_.height_cells);
    return true;
  }
  // In cells, and before they are counted in whole numbers.
  const double limit = options_.max_extent_m / r;
  const glm::dvec2 from = glm::min((low_m - frame_.origin_m) / r, glm::dvec2(0.0));
  const glm::dvec2 to = glm::max((high_m - frame_.origin_m) / r,
                                 glm::dvec2(frame_.width_cells, frame_.height_cells));
  if (to.x - from.x > limit || to.y - from.y > limit) {
    exhausted_ = true;
    return false;
  }
  const Cell low = frame_.cell_at(low_m), high = frame_.cell_at(high_m);
  const auto steps = [&](int missing) {
    return missing > 0 ? (missing + step - 1) / step * step : 0;
  };
  const int left = steps(-low.x), bottom = steps(-low.y);
  const int right = steps(high.x - frame_.width_cells + 1);
  const int top = steps(high.y - frame_.height_cells + 1);
  if (left + bottom + right + top == 0) return true;
  const int width = frame_.width_cells + left + right;
  const int height = frame_.height_cells + bottom + top;
  body_ = grown(body_, left, bottom, width, height);
  mast_ = grown(mast_, left, bottom, width, height);
  heights_ = grown(heights_, left, bottom, width, height);
  hole_views_ = grown(hole_views_, left, bottom, width, height);
  frame_.origin_m -= glm::dvec2(left, bottom) * r;
  frame_.width_cells = width;
  frame_.height_cells = height;
  return true;
}

/// Places the scratch window around the eye: two cells more than the range on each side.
void OccupancyMap::open_window(const glm::dvec2& eye_m) {
  const int reach = static_cast<int>(options_.max_range_m / frame_.resolution_m) + 2;
  const int side = 2 * reach + 1;
  if (seen_.width_px() != side) seen_ = core::Image<CellView>(side, side);
  seen_low_ = frame_.cell_at(eye_m) - reach;
}

std::size_t OccupancyMap::seen_index(const Cell& cell) const {
  return static_cast<std::size_t>(cell.y - seen_low_.y) *
             static_cast<std::size_t>(seen_.width_px()) +
         static_cast<std::size_t>(cell.x - seen_low_.x);
}

void OccupancyMap::begin_view(std::size_t seen_index) {
  CellView& cell = seen_.data()[seen_index];
  const auto side = static_cast<std::uint32_t>(seen_.width_px());
  const auto index = static_cast<std::uint32_t>(seen_index);
  const std::uint32_t y = index / side;
  const Cell at = seen_low_ + Cell(static_cast<int>(index - y * side), static_cast<int>(y));
  cell = {};
  cell.stamp = stamp_;
  cell.lowest_pass_m = 1e3F;
  const Heights& stored = heights_(at.x, at.y);
  cell.obstacle =
      stored.body_low_m != Heights{}.body_low_m || stored.mast_low_m != Heights{}.mast_low_m;
  touched_.push_back(at);
}

void OccupancyMap::note_changed(const Cell& cell) { changed_.add(cell + frame_.lattice()); }

CellBox OccupancyMap::observed() const {
  if (observed_.empty()) return {};
  const Cell lattice = frame_.lattice();
  return {observed_.low - lattice, observed_.high - lattice};
}

CellBox OccupancyMap::take_changed() {
  const Cell lattice = frame_.lattice();
  const CellBox changed = changed_;
  changed_ = {};
  if (changed.empty()) return {};
  return {changed.low - lattice, changed.high - lattice};
}

/// Every pixel: which cell does it end in, and at what height? This loop is a hot one; its
/// arithmetic is apart from its branches, so that it vectorises.
void OccupancyMap::mark_end_points(const core::Image<float>& depth_m, const View& view) {
  const int width = depth_m.width_px(), height = depth_m.height_px();
  const auto count = static_cast<std::size_t>(width);
  // p = eye + depth * (column part + row part), in floats: millimetres at 10 m.
  std::vector<float> columns_x(count), columns_y(count), columns_z(count);
  for (std::size_t x = 0; x < count; ++x) {
    const double u =
        (static_cast<double>(x) + 0.5 - view.intrinsics.cx_px) / view.intrinsics.fx_px;
    const glm::vec3 column(view.R_odom_camera[0] * u);
    columns_x[x] = column.x;
    columns_y[x] = column.y;
    columns_z[x] = column.z;
  }
  const auto inverse_resolution = static_cast<float>(1.0 / frame_.resolution_m);
  const glm::vec2 eye_cells((view.eye_m.x - frame_.origin_m.x) / frame_.resolution_m,
                            (view.eye_m.y - frame_.origin_m.y) / frame_.resolution_m);
  const auto min_z = static_cast<float>(options_.obstacle_min_m);
  const auto max_z = static_cast<float>(options_.obstacle_max_m);
  const auto max_range_cells = static_cast<float>(options_.max_range_m / frame_.resolution_m);
  EndLimits limits{};
  limits.eye_x = eye_cells.x;
  limits.eye_y = eye_cells.y;
  limits.eye_z = static_cast<float>(view.eye_m.z);
  limits.mast_z = static_cast<float>(view.mast_top_m);
  limits.per_cell = inverse_resolution;
  limits.range2 = max_range_cells * max_range_cells;
  limits.side = seen_.width_px();
  limits.first = seen_low_.y * limits.side + seen_low_.x;

  std::vector<float> heights_m(count);
  std::vector<std::int32_t> ends(count);
  for (int y = 0; y < height; ++y) {
    const double v = (y + 0.5 - view.intrinsics.cy_px) / view.intrinsics.fy_px;
    const glm::vec3 row(view.R_odom_camera[1] * v + view.R_odom_camera[2]);
    find_ends(depth_m.row(y), columns_x.data(), columns_y.data(), columns_z.data(), row,
              limits, count, heights_m.data(), ends.data());
    for (std::size_t x = 0; x < count; ++x) {
      if (ends[x] < 0) continue;
      const float z = heights_m[x];
      if (z >= min_z && options_.reject_flying_pixels &&
          flying_pixel(depth_m, static_cast<int>(x), y)) {
        continue;
      }
      CellView& cell = touch(static_cast<std::size_t>(ends[x]));
      if (z < min_z) {
        cell.lowest_pass_m = 0.0F;
        ++cell.floor_hits;
      } else if (z <= max_z) {
        ++cell.body_hits;
        cell.heights.body_low_m = std::min(cell.heights.body_low_m, z);
        cell.heights.body_top_m = std::max(cell.heights.body_top_m, z);
      } else {
        ++cell.mast_hits;
        cell.heights.mast_low_m = std::min(cell.heights.mast_low_m, z);
        cell.heights.mast_top_m = std::max(cell.heights.mast_top_m, z);
      }
    }
  }
}

/// Walks the planar projection of one ray and notes at which height it passes each cell. This
/// loop is the other hot one.
void OccupancyMap::trace_ray(const View& view, const glm::dvec3& direction, double depth_m) {
  const double planar = std::sqrt(direction.x * direction.x + direction.y * direction.y);
  const double r = frame_.resolution_m;
  const double range_m = std::min(planar * depth_m - r, options_.max_range_m);
  if (range_m <= 0.0) return;
  const int steps = static_cast<int>(range_m / r);
  const auto step_z = static_cast<float>(direction.z / planar * r);
  const auto step_x = static_cast<float>(direction.x / planar);
  const auto step_y = static_cast<float>(direction.y / planar);
  auto x = static_cast<float>((view.eye_m.x - frame_.origin_m.x) / r);
  auto y = static_cast<float>((view.eye_m.y - frame_.origin_m.y) / r);
  auto z = static_cast<float>(view.eye_m.z);
  const auto mast_above = static_cast<float>(options_.obstacle_max_m);
  const int side = seen_.width_px();
  const int first = seen_low_.y * side + seen_low_.x;
  for (int k = 0; k <= steps; ++k, x += step_x, y += step_y, z += step_z) {
    const int index = static_cast<int>(y) * side + static_cast<int>(x) - first;
    CellView& cell = touch(static_cast<std::size_t>(index));
    cell.lowest_pass_m = std::min(cell.lowest_pass_m, z);
    if (!cell.obstacle) continue;  // Nothing that a ray could contradict.
    const Heights& stored = heights_(static_cast<int>(x), static_cast<int>(y));
    cell.through_body |=
        z > stored.body_low_m - kPassLow_m && z < stored.body_top_m - kPassTop_m;
    if (z > mast_above) {
      cell.through_mast |=
          z > stored.mast_low_m - kPassTop_m && z < stored.mast_top_m + kPassTop_m;
    }
  }
}

void OccupancyMap::trace_rays(const core::Image<float>& depth_m, const View& view) {
  const int step_x = std::max(options_.ray_step_x_px, (depth_m.width_px() + 64) / 128);
  const int step_y = std::max(options_.ray_step_y_px, (depth_m.height_px() + 32) / 64);
  for (int y = step_y / 2; y < depth_m.height_px(); y += step_y) {
    for (int x = step_x / 2; x < depth_m.width_px(); x += step_x) {
      const float depth = depth_m(x, y);
      if (!(depth > 0.0F) || !std::isfinite(depth)) continue;
      const glm::dvec3 direction = view.direction(x + 0.5, y + 0.5);
      const double end_z_m = view.eye_m.z + depth * direction.z;
      // Rays that rise leave the mast's band at once.
      if (end_z_m > view.mast_top_m || end_z_m < -kFloorBelow_m) continue;
      trace_ray(view, direction, depth);
    }
  }
}

/// Whether a known obstacle stands on the ray before `range_m`.
bool OccupancyMap::hidden_by_obstacle(const View& view, const glm::dvec3& direction,
                                      double range_m) const {
  const double planar = std::hypot(direction.x, direction.y), r = frame_.resolution_m;
  for (double s = 0.0; s < range_m - 0.5 * r; s += r) {
    const glm::dvec3 p = view.eye_m + direction * (s / planar);
    const Cell cell = frame_.cell_at(glm::dvec2(p));
    const Heights& stored = heights_(cell.x, cell.y);
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
void OccupancyMap::note_holes(const core::Image<float>& depth_m, const View& view) {
  if (options_.hole_views <= 0) return;
  for (int y = 0; y < depth_m.height_px(); ++y) {
    for (int x = 0; x < depth_m.width_px(); x += options_.ray_step_x_px) {
      if (depth_m(x, y) > 0.0F) continue;
      const glm::dvec3 direction = view.direction(x + 0.5, y + 0.5);
      if (direction.z > -1e-3) continue;
      const double range_m =
          view.eye_m.z / -direction.z * std::hypot(direction.x, direction.y);
      if (range_m > std::min(options_.hole_range_m, options_.max_range_m)) continue;
      const glm::dvec3 p = view.eye_m + direction * (view.eye_m.z / -direction.z);
      const Cell cell = frame_.cell_at(glm::dvec2(p));
      if (body_(cell.x, cell.y) != 0.0F) continue;
      const std::size_t index = seen_index(cell);
      const CellView& seen = seen_.data()[index];
      if (seen.stamp == stamp_ && seen.hole) continue;
      if (!hidden_by_obstacle(view, direction, range_m)) touch(index).hole = true;
    }
  }
}

void OccupancyMap::fuse_hole(std::size_t index, const CellView& cell) {
  if (body_.data()[index] != 0.0F || cell.body_hits > 0 || cell.mast_hits > 0) return;
  std::uint8_t& views = hole_views_.data()[index];
  if (++views >= options_.hole_views) body_.data()[index] = kAssumedFree;
}

void OccupancyMap::fuse_body(std::size_t index, const CellView& cell, int hits_needed,
                             bool below_unseen) {
  float& odds = body_.data()[index];
  Heights& stored = heights_.data()[index];
  if (odds >= kBlocked) return;
  if (cell.body_hits >= hits_needed) {
    odds = std::min(odds + options_.log_odds_hit, options_.log_odds_max);
    stored.body_low_m = std::min(stored.body_low_m, cell.heights.body_low_m);
    stored.body_top_m = std::max(stored.body_top_m, cell.heights.body_top_m);
  } else if (below_unseen && cell.mast_hits >= hits_needed && odds > 2.0F * kAssumedFree) {
    // Near the robot only the upper part of a wall is in view. Take it to stand on the floor
    // unless that cell was seen to be free before.
    odds = std::min(odds + options_.log_odds_hit, options_.log_odds_max);
    stored.body_low_m = static_cast<float>(options_.obstacle_min_m);
    stored.body_top_m = static_cast<float>(options_.obstacle_max_m);
  } else if (cell.body_hits == 0) {  // A single point says neither this nor that.
    const bool occupied = odds > options_.occupied_above;
    const bool floor_instead = cell.floor_hits >= options_.min_hits_per_cell &&
                               (stored.body_low_m < kOverhang_m || odds < kSureOdds);
    const bool miss = occupied
                          ? cell.through_body || floor_instead
                          : cell.lowest_pass_m <= static_cast<float>(options_.pass_height_m);
    if (!miss) return;
    odds = std::max(odds - options_.log_odds_miss, options_.log_odds_min);
    if (odds < options_.free_below) {
      stored.body_low_m = Heights{}.body_low_m;
      stored.body_top_m = Heights{}.body_top_m;
    }
  }
}

void OccupancyMap::fuse_mast(std::size_t index, const CellView& cell, int hits_needed) {
  float& odds = mast_.data()[index];
  Heights& stored = heights_.data()[index];
  if (odds >= kBlocked) return;
  if (cell.mast_hits >= hits_needed) {
    odds = std::min(odds + options_.log_odds_hit, options_.log_odds_max);
    stored.mast_low_m = std::min(stored.mast_low_m, cell.heights.mast_low_m);
    stored.mast_top_m = std::max(stored.mast_top_m, cell.heights.mast_top_m);
  } else if (cell.mast_hits == 0 && cell.through_mast) {
    odds = std::max(odds - options_.log_odds_miss, options_.log_odds_min);
    if (odds < options_.free_below) {
      stored.mast_low_m = Heights{}.mast_low_m;
      stored.mast_top_m = Heights{}.mast_top_m;
    }
  }
}

void OccupancyMap::fuse_view(const View& view) {
  const glm::dvec2 eye(view.eye_m);
  const double blind2 = view.blind_range_m * view.blind_range_m;
  // Pixels of a facing square of one cell at 1 m; the number falls with the distance squared.
  const double square_px = options_.hit_share * frame_.resolution_m * frame_.resolution_m *
                           view.intrinsics.fx_px * view.intrinsics.fy_px;
  CellBox changed, observed;
  for (const Cell& at : touched_) {
    const CellView& cell = seen_.data()[seen_index(at)];
    const std::size_t index =
        static_cast<std::size_t>(at.y) * static_cast<std::size_t>(frame_.width_cells) +
        static_cast<std::size_t>(at.x);
    bool below_unseen = false;
    int hits_needed = options_.min_hits_per_cell;
    if (cell.mast_hits > 0 || cell.body_hits > 0) {
      const glm::dvec2 offset = frame_.center_m(at) - eye;
      const double range2 = glm::dot(offset, offset);
      below_unseen = cell.mast_hits > 0 && range2 < blind2;
      // Nearer than 1 m the camera looks over what it hits at a slant.
      hits_needed = std::max(hits_needed, static_cast<int>(square_px / std::max(range2, 1.0)));
    }
    fuse_body(index, cell, hits_needed, below_unseen);
    fuse_mast(index, cell, hits_needed);
    if (cell.hole) fuse_hole(index, cell);
    changed.add(at);
    if (body_.data()[index] != 0.0F) observed.add(at);
  }
  const Cell lattice = frame_.lattice();
  if (!changed.empty()) changed_.add(CellBox{changed.low + lattice, changed.high + lattice});
  if (!observed.empty())
    observed_.add(CellBox{observed.low + lattice, observed.high + lattice});
}

void OccupancyMap::mark_free_disc(const glm::dvec2& center_odom_m, double radius_m) {
  if (!ensure_covers(center_odom_m - radius_m, center_odom_m + radius_m)) return;
  for_each_cell_in_disc(frame_, center_odom_m, radius_m, [&](int i, int j) {
    body_(i, j) = mast_(i, j) = options_.log_odds_min;
    heights_(i, j) = {};
    note_changed({i, j});
    observed_.add(Cell(i, j) + frame_.lattice());
  });
}

void OccupancyMap::mark_blocked_disc(const glm::dvec2& center_odom_m, double radius_m) {
  if (!ensure_covers(center_odom_m - radius_m, center_odom_m + radius_m)) return;
  for_each_cell_in_disc(frame_, center_odom_m, radius_m, [&](int i, int j) {
    body_(i, j) = kBlocked;
    note_changed({i, j});
    observed_.add(Cell(i, j) + frame_.lattice());
  });
}

void OccupancyMap::assume_free_disc(const glm::dvec2& center_odom_m, double radius_m) {
  for_each_cell_in_disc(frame_, center_odom_m, radius_m, [&](int i, int j) {
    if (body_(i, j) != 0.0F) return;
    body_(i, j) = kAssumedFree;
    note_changed({i, j});
    observed_.add(Cell(i, j) + frame_.lattice());
  });
}

CellState OccupancyMap::body_state(const Cell& cell) const {
  if (!frame_.contains(cell)) return CellState::kUnknown;
  const float odds = body_(cell.x, cell.y);
  if (odds > options_.occupied_above) return CellState::kOccupied;
  return odds < options_.free_below ? CellState::kFree : CellState::kUnknown;
}

bool OccupancyMap::mast_blocked(const Cell& cell) const {
  return frame_.contains(cell) && mast_(cell.x, cell.y) > options_.occupied_above;
}

void OccupancyMap::integrate(const core::Observation& observation) {
  SEGSIM_CHECK(observation.depth_m != nullptr, "observation without depth");
  const core::Image<float>& depth_m = *observation.depth_m;
  SEGSIM_CHECK(depth_m.width_px() == observation.intrinsics.width_px &&
                   depth_m.height_px() == observation.intrinsics.height_px,
               "depth image and intrinsics differ in size");
  const int n = thinning_of(depth_m);
  if (n == 1) {
    fuse_image(depth_m, View(observation, options_));
  } else {
    core::Observation thinned = observation;
    thinned.intrinsics = thinned_camera(observation.intrinsics, n);
    thin_out(depth_m, n, thinned_m_);
    fuse_image(thinned_m_, View(thinned, options_));
  }
}

void OccupancyMap::fuse_image(const core::Image<float>& depth_m, const View& view) {
  const glm::dvec2 robot(view.robot_m), eye(view.eye_m);

  const double reach_m = options_.max_range_m + 4.0 * frame_.resolution_m;
  if (!ensure_covers(glm::min(robot, eye) - reach_m, glm::max(robot, eye) + reach_m)) return;
  if (!started_) {
    const double blind_m = view.range_where_lowest_ray_is_at(options_.pass_height_m);
    assume_free_disc(robot, options_.start_free_radius_m > 0.0
                                ? options_.start_free_radius_m
                                : std::min(blind_m + 0.1, kMaxStartFree_m));
    started_ = true;
  }

  ++stamp_;
  touched_.clear();
  open_window(eye);
  mark_end_points(depth_m, view);
  trace_rays(depth_m, view);
  note_holes(depth_m, view);
  fuse_view(view);

  // The inscribed circle is free for certain; the ring around it only where nothing was seen.
  mark_free_disc(robot, kInscribedShare * options_.footprint_radius_m);
  assume_free_disc(robot, std::max(options_.near_free_radius_m, options_.footprint_radius_m));
}

}  // namespace segsim::nav
