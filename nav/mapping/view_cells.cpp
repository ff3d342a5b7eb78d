#include "nav/mapping/view_cells.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/process/vector_clones.h"
#include "nav/mapping/internal/set_bytes.h"

namespace segsim::nav {
namespace {

constexpr double kFloorBelow_m = 0.20;  // Points deeper below the floor are wrong.
constexpr float kPassLow_m = 0.10F;     // A ray contradicts an obstacle from this far below
constexpr float kPassTop_m = 0.02F;     // its lowest hit to this far below its top.

/// Whether a pixel lies on the blend between two surfaces along one image axis: strictly
/// between its neighbours, apart from both, while the surfaces beyond go on smoothly. On a
/// plane, however slanted, inverse depth is linear in the pixel, so all differences are equal.
bool blended(const float* depth, std::ptrdiff_t step) {
  const float a = depth[-step], b = depth[step];
  const float inner = std::abs(1.0F / a - 1.0F / b);
  const float outer = std::abs(1.0F / depth[-2 * step] - 1.0F / a) +
                      std::abs(1.0F / b - 1.0F / depth[2 * step]);
  return !(outer >= 0.8F * inner);  // Holes next to it: no plane.
}

/// steep[x] = 1 where a pixel lies strictly between two neighbours that are far apart, and is
/// apart from both. No branches, so that it vectorises; NaN compares false and drops out.
SEGSIM_VECTOR_CLONES
void find_steps(const float* __restrict depth, const float* __restrict before,
                const float* __restrict after, std::size_t count,
                std::uint8_t* __restrict steep) {
  for (std::size_t x = 0; x < count; ++x) {
    const float d = depth[x], a = before[x], b = after[x];
    const float to_a = std::abs(d - a), to_b = std::abs(d - b);
    const float nearer = to_a < to_b ? to_a : to_b;
    const int is = static_cast<int>((d - a) * (b - d) > 0.0F) &
                   static_cast<int>(std::abs(b - a) >= 0.15F + 0.05F * d) &
                   static_cast<int>(nearer >= 0.03F + 0.01F * d);
    steep[x] = static_cast<std::uint8_t>(is);
  }
}

/// Which pixels of a row are no surface but the blend between two.
void find_flying(const core::Image<float>& depth_m, int y, std::vector<std::uint8_t>& steep,
                 std::vector<std::uint8_t>& flying) {
  const int width = depth_m.width_px(), height = depth_m.height_px();
  std::fill(flying.begin(), flying.end(), std::uint8_t{0});
  const float* row = depth_m.row(y);
  const auto check = [&](int first, int count, std::ptrdiff_t step) {
    find_steps(row + first, row + first - step, row + first + step,
               static_cast<std::size_t>(count), steep.data());
    internal::for_each_set(steep.data(), static_cast<std::size_t>(count), 1,
                           [&](std::size_t x) {
                             if (blended(row + first + x, step))
                               flying[static_cast<std::size_t>(first) + x] = 1;
                           });
  };
  if (width > 4) check(2, width - 4, 1);
  if (y >= 2 && y + 2 < height) check(0, width, width);
}

/// What find_ends() needs besides the pixels; cells are those of the window.
struct EndLimits {
  float eye_x, eye_y;  ///< [cells]
  float eye_z, mast_z;
  float per_cell, range2;
  int side;
};

/// Heights and cells (indices into the window; -1: of no use) in which a row's pixels end.
/// Only selections, no branches, so that it vectorises.
SEGSIM_VECTOR_CLONES
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
    // Inside the window, hence positive: truncation is floor.
    const auto i = static_cast<std::int32_t>(l.eye_x + (used != 0 ? dx : 0.0F));
    const auto j = static_cast<std::int32_t>(l.eye_y + (used != 0 ? dy : 0.0F));
    heights_m[x] = z;
    ends[x] = used != 0 ? j * l.side + i : -1;
  }
}

/// Window indices of evenly spaced points of a ray, from the first one asked for. Whole
/// numbers up to 2^24 are exact in floats, and these instructions exist for them everywhere.
SEGSIM_VECTOR_CLONES
void find_ray_cells(const glm::vec2& from_cells, const glm::vec2& step_cells, int side,
                    int first, int count, std::int32_t* __restrict cells) {
  const float from_x = from_cells.x, from_y = from_cells.y;
  const float step_x = step_cells.x, step_y = step_cells.y;
  const auto stride = static_cast<float>(side);
  for (int k = first; k < count; ++k) {
    const auto steps = static_cast<float>(k);
    const auto i = static_cast<std::int32_t>(from_x + steps * step_x);
    const auto j = static_cast<std::int32_t>(from_y + steps * step_y);
    cells[k] = i + static_cast<std::int32_t>(static_cast<float>(j) * stride);
  }
}

/// Steps [first, end) of a ray.
struct Stretch {
  int first, end;
};

/// Where a ray is at most `top_m` high. @param from_m, step_m  Its height at first and what a
/// step adds; it consists of `count` steps.
Stretch low_part(float from_m, float step_m, float top_m, int count) {
  const auto high_at = [&](int k) { return from_m + static_cast<float>(k) * step_m > top_m; };
  Stretch low{0, count};
  if (from_m > top_m) {
    const float steps = step_m < 0.0F ? (top_m - from_m) / step_m : 1e6F;
    low.first = static_cast<int>(std::min(steps, static_cast<float>(count)));
  }
  while (low.first < low.end && high_at(low.first)) ++low.first;
  while (low.first < low.end && high_at(low.end - 1)) --low.end;
  return low;
}

}  // namespace

MappingCamera::MappingCamera(const core::Observation& observation)
    : intrinsics(observation.intrinsics) {
  const auto T_odom_camera = observation.T_odom_camera();
  R_odom_camera = glm::mat3_cast(T_odom_camera.rotation());
  robot_m = glm::dvec2(observation.T_odom_robot.translation_m());
  eye_m = T_odom_camera.translation_m();
  eye_m.z -= observation.T_odom_robot.translation_m().z;
}

double MappingCamera::range_where_lowest_ray_is_at(double height_m) const {
  const glm::dvec3 d = direction(intrinsics.cx_px, intrinsics.height_px);
  const double planar = std::hypot(d.x, d.y);
  if (eye_m.z <= height_m) return 0.0;
  return d.z < -1e-6 ? (eye_m.z - height_m) / -d.z * planar : 1e3;
}

void ViewCells::open(const GridFrame& frame, const GridLayer<std::uint8_t>& obstacles,
                     const MappingCamera& camera, const ViewLimits& limits) {
  limits_ = limits;
  resolution_m_ = frame.resolution_m;
  const int reach = static_cast<int>(limits.max_range_m / resolution_m_) + 2;
  const int side = 2 * reach + 1;
  const glm::dvec2 eye_m(camera.eye_m);
  const Cell eye = frame.cell_at(eye_m);
  low_ = eye - reach;
  const CellBox window{low_, low_ + (side - 1)};
  SEGSIM_CHECK(window.clipped_to(frame.box()) == window, "the map does not cover the view");
  eye_cells_ = glm::vec2((eye_m - frame.origin_m) / resolution_m_ - glm::dvec2(low_));
  if (marks_.width_px() != side) {
    marks_ = core::Image<std::uint8_t>(side, side);
    floor_hits_ = core::Image<std::uint16_t>(side, side);
    hits_ = core::Image<Hits>(side, side);
  }
  std::fill(floor_hits_.pixels().begin(), floor_hits_.pixels().end(), std::uint16_t{0});
  for (int j = 0; j < side; ++j) {
    // kObstacle is 1, what the map has.
    std::copy_n(obstacles.row(low_.y + j) + low_.x, side, marks_.row(j));
  }
  horizon_.find(marks_);
}

void ViewCells::note_hit(std::size_t index, float height_m) {
  Hits& hits = hits_.data()[index];
  std::uint8_t& marks = marks_.data()[index];
  if ((marks & kHit) == 0) hits = {};
  marks |= kHit | kSaysSomething;
  if (height_m <= static_cast<float>(limits_.obstacle_max_m)) {
    ++hits.body;
    hits.heights.body_low_m = std::min(hits.heights.body_low_m, height_m);
    hits.heights.body_top_m = std::max(hits.heights.body_top_m, height_m);
  } else {
    ++hits.mast;
    hits.heights.mast_low_m = std::min(hits.heights.mast_low_m, height_m);
    hits.heights.mast_top_m = std::max(hits.heights.mast_top_m, height_m);
  }
}

/// This loop is a hot one; its arithmetic is apart from its branches, so that it vectorises.
void ViewCells::mark_end_points(const core::Image<float>& depth_m,
                                const MappingCamera& camera) {
  const int width = depth_m.width_px(), height = depth_m.height_px();
  const auto count = static_cast<std::size_t>(width);
  // p = eye + depth * (column part + row part), in floats: millimetres at 10 m.
  std::vector<float> columns_x(count), columns_y(count), columns_z(count);
  for (std::size_t x = 0; x < count; ++x) {
    const double u =
        (static_cast<double>(x) + 0.5 - camera.intrinsics.cx_px) / camera.intrinsics.fx_px;
    const glm::vec3 column(camera.R_odom_camera[0] * u);
    columns_x[x] = column.x;
    columns_y[x] = column.y;
    columns_z[x] = column.z;
  }
  const auto range_cells = static_cast<float>(limits_.max_range_m / resolution_m_);
  const EndLimits limits{eye_cells_.x,
                         eye_cells_.y,
                         static_cast<float>(camera.eye_m.z),
                         static_cast<float>(limits_.mast_top_m),
                         static_cast<float>(1.0 / resolution_m_),
                         range_cells * range_cells,
                         side()};
  const auto min_z = static_cast<float>(limits_.obstacle_min_m);
  std::vector<float> heights_m(count);
  std::vector<std::int32_t> ends(count);
  std::vector<std::uint8_t> steep(count), flying(count, 0);
  for (int y = 0; y < height; ++y) {
    const double v = (y + 0.5 - camera.intrinsics.cy_px) / camera.intrinsics.fy_px;
    const glm::vec3 row(camera.R_odom_camera[1] * v + camera.R_odom_camera[2]);
    find_ends(depth_m.row(y), columns_x.data(), columns_y.data(), columns_z.data(), row,
              limits, count, heights_m.data(), ends.data());
    if (limits_.reject_flying_pixels) find_flying(depth_m, y, steep, flying);
    for (std::size_t x = 0; x < count; ++x) {
      if (ends[x] < 0) continue;
      const auto index = static_cast<std::size_t>(ends[x]);
      const float z = heights_m[x];
      if (z < min_z) {
        ++floor_hits_.data()[index];
        marks_.data()[index] |= kSaysSomething | kPassedLow;
      } else if (flying[x] == 0) {
        note_hit(index, z);
      }
    }
  }
}

/// What a ray that passes an obstacle at this height says about it.
void ViewCells::note_obstacle(std::int32_t cell, float height_m,
                              const GridLayer<HitHeights>& stored) {
  const int row = cell / side();
  const HitHeights& there = stored(low_.x + cell - row * side(), low_.y + row);
  std::uint8_t& mark = marks_.data()[cell];
  if (height_m > there.body_low_m - kPassLow_m && height_m < there.body_top_m - kPassTop_m) {
    mark |= kThroughBody | kSaysSomething;
  }
  if (height_m > static_cast<float>(limits_.obstacle_max_m) &&
      height_m > there.mast_low_m - kPassTop_m && height_m < there.mast_top_m + kPassTop_m) {
    mark |= kThroughMast | kSaysSomething;
  }
}

/// Walks the planar projection of one ray and notes which cells it passes low, and what it
/// says about obstacles. High above the floor it says nothing about the others. This loop is
/// the other hot one.
void ViewCells::trace_ray(const MappingCamera& camera, const glm::dvec3& direction,
                          double depth_m, const GridLayer<HitHeights>& stored) {
  const double planar = std::sqrt(direction.x * direction.x + direction.y * direction.y);
  const double r = resolution_m_;
  const double range_m = std::min(planar * depth_m - r, limits_.max_range_m);
  if (range_m <= 0.0) return;
  const int count = static_cast<int>(range_m / r) + 1;
  const glm::vec2 step_cells(glm::dvec2(direction) / planar);
  const auto step_z = static_cast<float>(direction.z / planar * r);
  const auto from_z = static_cast<float>(camera.eye_m.z);
  const Stretch low =
      low_part(from_z, step_z, static_cast<float>(limits_.pass_height_m), count);
  const int first = std::min(low.first, horizon_.free_cells(step_cells.x, step_cells.y));
  if (first >= count) return;

  if (ray_cells_.size() < static_cast<std::size_t>(count)) {
    ray_cells_.resize(static_cast<std::size_t>(count));
    ray_met_.resize(ray_cells_.size());
  }
  std::int32_t* cells = ray_cells_.data();
  find_ray_cells(eye_cells_, step_cells, side(), first, count, cells);
  // Few cells hold an obstacle. They are listed without a branch, which would be guessed
  // wrong.
  std::uint8_t* marks = marks_.data();
  std::int32_t* met = ray_met_.data();
  int mets = 0;
  const auto list = [&](int k) {
    met[mets] = k;
    mets += static_cast<int>((marks[cells[k]] & kObstacle) != 0);
  };
  for (int k = first; k < low.first; ++k) list(k);
  for (int k = low.first; k < low.end; ++k) {
    list(k);
    marks[cells[k]] |= kSaysSomething | kPassedLow;
  }
  for (int k = low.end; k < count; ++k) list(k);
  for (int m = 0; m < mets; ++m) {
    note_obstacle(cells[met[m]], from_z + static_cast<float>(met[m]) * step_z, stored);
  }
}

void ViewCells::trace_rays(const core::Image<float>& depth_m, const MappingCamera& camera,
                           const GridLayer<HitHeights>& stored, int step_x_px, int step_y_px) {
  // As MappingCamera::direction(), to the last bit; most of it once per column and row.
  const core::CameraIntrinsics& pinhole = camera.intrinsics;
  std::vector<glm::dvec3> columns;
  for (int x = step_x_px / 2; x < depth_m.width_px(); x += step_x_px) {
    columns.push_back(camera.R_odom_camera[0] * ((x + 0.5 - pinhole.cx_px) / pinhole.fx_px));
  }
  for (int y = step_y_px / 2; y < depth_m.height_px(); y += step_y_px) {
    const glm::dvec3 row =
        camera.R_odom_camera[1] * ((y + 0.5 - pinhole.cy_px) / pinhole.fy_px);
    const float* depths = depth_m.row(y) + step_x_px / 2;
    for (const glm::dvec3& column : columns) {
      const float depth = *depths;
      depths += step_x_px;
      if (!(depth > 0.0F) || !std::isfinite(depth)) continue;
      const glm::dvec3 direction = column + row + camera.R_odom_camera[2];
      const double end_z_m = camera.eye_m.z + static_cast<double>(depth) * direction.z;
      // Rays that rise leave the mast's band at once.
      if (end_z_m > limits_.mast_top_m || end_z_m < -kFloorBelow_m) continue;
      trace_ray(camera, direction, static_cast<double>(depth), stored);
    }
  }
}

}  // namespace segsim::nav
