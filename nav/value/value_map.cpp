#include "nav/value/value_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

#include "core/check.h"
#include "core/process/vector_clones.h"
#include "nav/mapping/depth_cleanup.h"

namespace segsim::nav {
namespace {

constexpr int kBearings = 2048;  // Of the tables over the view; confidences are interpolated.

bool same_view(const core::CameraIntrinsics& a, const core::CameraIntrinsics& b) {
  return a.width_px == b.width_px && a.height_px == b.height_px && a.fx_px == b.fx_px &&
         a.cx_px == b.cx_px;
}

constexpr float kNone = std::numeric_limits<float>::max();

struct RowLimits {
  float min_z, max_z,
      max_depth;  ///< The band relative to the camera; depths count up to here.
};

/// One row of depth updates each column's nearest depth in the band and farthest depth. Only
/// selections, no branches, so that it vectorises; NaN compares false and drops out.
SEGSIM_VECTOR_CLONES
void take_row(const float* __restrict depths, const float* __restrict roll, float slope,
              const RowLimits& limits, std::size_t count, float* __restrict nearest,
              float* __restrict farthest) {
  const float min_z = limits.min_z, max_z = limits.max_z, most = limits.max_depth;
  for (std::size_t x = 0; x < count; ++x) {
    const float depth = depths[x] > 0.0F ? depths[x] : 0.0F;
    const float clipped = depth < most ? depth : most;
    const float z = depth * (slope + roll[x]);
    farthest[x] = clipped > farthest[x] ? clipped : farthest[x];
    float near = depth > 0.0F ? clipped : kNone;
    near = z >= min_z ? near : kNone;
    near = z <= max_z ? near : kNone;
    nearest[x] = near < nearest[x] ? near : nearest[x];
  }
}

/// Limits of i along a row of cells within which `a + b i >= 0` may hold.
void cut_by(double a, double b, double& first, double& last) {
  if (b > 0.0) {
    first = std::max(first, -a / b);
  } else if (b < 0.0) {
    last = std::min(last, -a / b);
  } else if (a < 0.0) {
    last = first - 1.0;
  }
}

}  // namespace

double view_confidence(double bearing_rad, double fov_rad, double min_confidence) {
  const double part = std::min(std::abs(bearing_rad) / (0.5 * fov_rad), 1.0);
  const double cosine = std::cos(part * 0.5 * std::numbers::pi);
  return min_confidence + (1.0 - min_confidence) * cosine * cosine;
}

ValueCell fuse(const ValueCell& old, const ValueCell& seen, const ValueMapOptions& options) {
  ValueCell now = seen;
  switch (options.fusion) {
    case FusionRule::kReplace:
      return now.confidence > 0.0F ? ValueCell{1.0F, now.value} : old;
    case FusionRule::kEqualWeighting:
      // The confidence counts the views.
      if (now.confidence <= 0.0F) return old;
      return {old.confidence + 1.0F,
              (old.confidence * old.value + now.value) / (old.confidence + 1.0F)};
    default:
      break;
  }
  if (now.confidence < static_cast<float>(options.decision_threshold) &&
      now.confidence < old.confidence) {
    now.confidence = 0.0F;
  }
  if (options.fusion == FusionRule::kMaxConfidence) {
    return now.confidence > old.confidence ? now : old;
  }
  const float sum = old.confidence + now.confidence;
  if (!(sum > 0.0F)) return {};
  return {(old.confidence * old.confidence + now.confidence * now.confidence) / sum,
          (old.confidence * old.value + now.confidence * now.value) / sum};
}

std::vector<float> column_limits_m(const core::Observation& observation,
                                   const ValueMapOptions& options, const VlfmRules& rules) {
  SEGSIM_CHECK(observation.depth_m != nullptr, "observation without depth");
  const core::Image<float>& depth_m = *observation.depth_m;
  const auto columns = static_cast<std::size_t>(depth_m.width_px());
  const auto low = static_cast<float>(options.min_depth_m);
  const auto high = static_cast<float>(options.max_depth_m);
  std::vector<float> farthest(columns, 0.0F);
  if (rules.published(Quirk::kFarthestDepth)) {
    // Missing depth is 0, the near end of the range.
    std::fill(farthest.begin(), farthest.end(), low);
    for (int y = 0; y < depth_m.height_px(); ++y) {
      const float* row = depth_m.row(y);
      for (std::size_t x = 0; x < columns; ++x) {
        // Clamped before the comparison; NaN compares false and drops out.
        if (row[x] > farthest[x]) farthest[x] = std::min(row[x], high);
      }
    }
    return farthest;
  }
  std::vector<float> nearest(columns, kNone);
  const glm::dmat3 R = glm::mat3_cast(observation.T_odom_camera().rotation());
  const core::CameraIntrinsics& camera = observation.intrinsics;
  const double eye_z = observation.T_odom_camera().translation_m().z -
                       observation.T_odom_robot.translation_m().z;
  const auto min_z = static_cast<float>(options.band_min_m - eye_z);
  const auto max_z = static_cast<float>(options.band_max_m - eye_z);
  std::vector<float> roll(columns);  // What a column adds to the slope; 0 without roll.
  for (std::size_t x = 0; x < columns; ++x) {
    roll[x] = static_cast<float>(R[0].z / camera.fx_px * static_cast<double>(x));
  }
  for (int y = 0; y < depth_m.height_px(); ++y) {
    const float* row = depth_m.row(y);
    const auto slope =
        static_cast<float>(R[1].z * ((y + 0.5 - camera.cy_px) / camera.fy_px) + R[2].z +
                           R[0].z * ((0.5 - camera.cx_px) / camera.fx_px));
    take_row(row, roll.data(), slope, {min_z, max_z, high}, columns, nearest.data(),
             farthest.data());
  }
  for (std::size_t x = 0; x < columns; ++x) {
    if (nearest[x] != kNone) farthest[x] = nearest[x];
  }
  return farthest;
}

ValueMap::ValueMap(const ValueMapOptions& options, const VlfmRules& rules)
    : options_(options), rules_(rules) {
  SEGSIM_CHECK(options.growth.resolution_m > 0.0, "resolution_m");
  SEGSIM_CHECK(options.max_depth_m > options.min_depth_m, "depth range");
  if (rules_.published(Quirk::kMapEdge)) {
    const double resolution_m = options_.growth.resolution_m;
    options_.growth = published_square();
    options_.growth.resolution_m = resolution_m;
  }
}

void ValueMap::reset() {
  frame_ = {};
  cells_ = {};
}

void ValueMap::update(const core::Observation& observation, double value) {
  const glm::dvec2 robot(observation.T_odom_robot.translation_m());
  if (frame_.width_cells == 0) frame_ = first_frame(options_.growth, robot);
  const double reach_m = options_.max_depth_m + 1.0;
  const auto margins = grow(frame_, options_.growth, robot - reach_m, robot + reach_m);
  cells_.cover(frame_, margins);
  limits_m_ = column_limits_m(observation, options_, rules_);
  if (limits_m_.empty()) return;
  fuse_cone(observation, limits_m_, static_cast<float>(value));
}

void ValueMap::make_tables(const core::CameraIntrinsics& camera, std::size_t columns) {
  ConeTables& tables = tables_;
  if (same_view(tables.camera, camera) && !tables.column.empty()) return;
  tables = {};
  tables.camera = camera;
  tables.left_tan = camera.cx_px / camera.fx_px;
  tables.right_tan = (camera.width_px - camera.cx_px) / camera.fx_px;
  const double fov = camera.horizontal_fov_rad();
  const auto last = static_cast<double>(columns) - 1.0;
  const bool even_angles = rules_.published(Quirk::kFarthestDepth);
  for (int k = 0; k <= kBearings; ++k) {
    const double right =
        -tables.left_tan + (tables.left_tan + tables.right_tan) * k / kBearings;
    const double bearing = std::atan(right);
    tables.confidence.push_back(
        static_cast<float>(view_confidence(bearing, fov, options_.min_confidence)));
    // Published: columns spread evenly in angle; they are even in tangent.
    const double column =
        even_angles ? (bearing / fov + 0.5) * last : right * camera.fx_px + camera.cx_px - 0.5;
    tables.column.push_back(static_cast<std::uint32_t>(
        std::clamp(std::lround(column), 0L, static_cast<long>(last))));
  }
}

/// Every cell of the cone. This loop is the hot one.
void ValueMap::fuse_cone(const core::Observation& observation, std::span<const float> limits_m,
                         float value) {
  make_tables(observation.intrinsics, limits_m.size());
  tables_.limit_m.resize(tables_.column.size());
  std::transform(tables_.column.begin(), tables_.column.end(), tables_.limit_m.begin(),
                 [&](std::uint32_t column) { return limits_m[column]; });
  const auto T = observation.T_odom_camera();
  const glm::dvec3 axis3 = T.rotation() * glm::dvec3(0.0, 0.0, 1.0);
  const glm::dvec2 axis_m = glm::dvec2(axis3);
  if (glm::length(axis_m) < 1e-6) return;  // Looks straight up or down.
  const glm::vec2 axis(glm::normalize(axis_m));
  const glm::dvec2 eye_m(T.translation_m());
  const double r = frame_.resolution_m;
  const double range_m =
      std::min(options_.max_depth_m,
               static_cast<double>(*std::max_element(limits_m.begin(), limits_m.end())) *
                       std::hypot(1.0, std::max(tables_.left_tan, tables_.right_tan)) +
                   r);
  const Cell low = frame_.cell_at(eye_m - range_m);
  const Cell high = frame_.cell_at(eye_m + range_m);
  const auto range2 = static_cast<float>(options_.max_depth_m * options_.max_depth_m);
  const auto left_tan = static_cast<float>(tables_.left_tan);
  const auto right_tan = static_cast<float>(tables_.right_tan);
  const float per_tan = static_cast<float>(kBearings) / (left_tan + right_tan);
  const bool wrap = options_.growth.wrap;
  for (int j = low.y; j <= high.y; ++j) {
    if (!wrap && (j < 0 || j >= frame_.height_cells)) continue;
    const auto dy = static_cast<float>(frame_.origin_m.y + (j + 0.5) * r - eye_m.y);
    // The part of the row between the sides of the cone, one cell wider: the exact test is
    // below. With right = dx axis.y - dy axis.x and forward = dx axis.x + dy axis.y.
    const double dx0 = frame_.origin_m.x + (low.x + 0.5) * r - eye_m.x;
    const glm::dvec2 a(axis);
    double first = 0.0, last = high.x - low.x;
    const double forward0 = dx0 * a.x + dy * a.y, right0 = dx0 * a.y - dy * a.x;
    cut_by(forward0, r * a.x, first, last);
    cut_by(right0 + tables_.left_tan * forward0, r * (a.y + tables_.left_tan * a.x), first,
           last);
    cut_by(tables_.right_tan * forward0 - right0, r * (tables_.right_tan * a.x - a.y), first,
           last);
    const double most = high.x - low.x;
    const int i0 = low.x + static_cast<int>(std::clamp(std::floor(first) - 1.0, 0.0, most));
    const int i1 = low.x + static_cast<int>(std::clamp(std::ceil(last) + 1.0, -1.0, most));
    for (int i = i0; i <= i1; ++i) {
      const auto dx = static_cast<float>(frame_.origin_m.x + (i + 0.5) * r - eye_m.x);
      const float forward = dx * axis.x + dy * axis.y;
      const float right = dx * axis.y - dy * axis.x;
      if (!(forward > 0.0F) || right < -left_tan * forward || right > right_tan * forward ||
          dx * dx + dy * dy > range2) {
        continue;
      }
      const float at = (right / forward + left_tan) * per_tan;
      const int k = std::min(static_cast<int>(at), kBearings - 1);
      const auto index = static_cast<std::size_t>(k);
      if (forward > tables_.limit_m[index]) continue;
      const float part = at - static_cast<float>(k);
      const float confidence =
          (1.0F - part) * tables_.confidence[index] + part * tables_.confidence[index + 1];
      Cell cell(i, j);
      if (!frame_.contains(cell)) {
        const auto other = wrap ? wrapped(frame_, cell) : std::nullopt;
        if (!other) continue;
        cell = *other;
      }
      ValueCell& old = cells_(cell.x, cell.y);
      old = fuse(old, {confidence, value}, options_);
    }
  }
}

ValueCell ValueMap::at(const glm::dvec2& p_odom_m) const {
  if (frame_.width_cells == 0) return {};
  const Cell cell = frame_.cell_at(p_odom_m);
  return frame_.contains(cell) ? cells_(cell.x, cell.y) : ValueCell{};
}

std::optional<double> ValueMap::median_around(const glm::dvec2& p_odom_m,
                                              double radius_m) const {
  if (frame_.width_cells == 0) return std::nullopt;
  const Cell center = frame_.cell_at(p_odom_m);
  const int radius = static_cast<int>(radius_m / frame_.resolution_m + 1e-9);
  std::vector<float> values;
  for (int dj = -radius; dj <= radius; ++dj) {
    for (int di = -radius; di <= radius; ++di) {
      if (di * di + dj * dj > radius * radius) continue;
      const Cell cell = center + Cell(di, dj);
      if (!frame_.contains(cell) || cells_(cell.x, cell.y).value == 0.0F) continue;
      values.push_back(cells_(cell.x, cell.y).value);
    }
  }
  if (values.empty()) return std::nullopt;
  // As numpy.median: the mean of the two middle ones for an even number.
  const std::size_t half = values.size() / 2;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(half),
                   values.end());
  const double upper = static_cast<double>(values[half]);
  if (values.size() % 2 == 1) return upper;
  const double lower = static_cast<double>(
      *std::max_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(half)));
  return 0.5 * (lower + upper);
}

}  // namespace segsim::nav
