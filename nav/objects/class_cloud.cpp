#include "nav/objects/class_cloud.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <set>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/vector_relational.hpp>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/check.h"
#include "nav/objects/dbscan.h"

namespace segsim::nav {
namespace {

constexpr double kImageWidth_px = 640.0, kImageArea_px2 = 640.0 * 480.0;
// As in nav/objects/object_map.cpp: a box is this uncertain, or by this share of its size; a
// point is in view if the depth there agrees.
constexpr float kCarveMargin_px = 3.0F, kCarveMargin = 0.1F;
constexpr double kCarveDepth_m = 0.15, kCarveNearest_m = 0.2;

/// A rectangle of pixels, its far corner excluded.
struct Extent {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  [[nodiscard]] int width() const { return x1 - x0; }
  [[nodiscard]] int height() const { return y1 - y0; }
  [[nodiscard]] bool empty() const { return x0 >= x1; }
};

/// The smallest one that holds all of a mask. Whole rows at once: which columns hold
/// something, and which rows?
Extent extent_of(const core::Image<std::uint8_t>& mask) {
  std::vector<std::uint8_t> columns(static_cast<std::size_t>(mask.width_px()), 0);
  Extent extent;
  for (int y = 0; y < mask.height_px(); ++y) {
    const std::uint8_t* row = mask.row(y);
    std::uint8_t any = 0;
    for (std::size_t x = 0; x < columns.size(); ++x) {
      columns[x] |= row[x];
      any |= row[x];
    }
    if (any == 0) continue;
    if (extent.y1 == 0) extent.y0 = y;
    extent.y1 = y + 1;
  }
  if (extent.y1 == 0) return {};
  const auto is_set = [](std::uint8_t value) { return value != 0; };
  extent.x0 =
      static_cast<int>(std::find_if(columns.begin(), columns.end(), is_set) - columns.begin());
  extent.x1 = static_cast<int>(columns.rend() -
                               std::find_if(columns.rbegin(), columns.rend(), is_set));
  return extent;
}

/// The part of a mask within an extent that holds all of it, eroded; the image's edge does not
/// erode.
core::Image<std::uint8_t> eroded(const core::Image<std::uint8_t>& mask, const Extent& extent,
                                 int passes) {
  // With what erodes from around.
  const Extent wide{std::max(extent.x0 - passes, 0), std::max(extent.y0 - passes, 0),
                    std::min(extent.x1 + passes, mask.width_px()),
                    std::min(extent.y1 + passes, mask.height_px())};
  core::Image<std::uint8_t> part(wide.width(), wide.height());
  for (int y = wide.y0; y < wide.y1; ++y) {
    std::copy_n(mask.row(y) + wide.x0, wide.width(), part.row(y - wide.y0));
  }
  cv::Mat image(wide.height(), wide.width(), CV_8U, part.data());
  cv::erode(image, image, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}), {-1, -1}, passes);
  core::Image<std::uint8_t> result(extent.width(), extent.height());
  for (int y = 0; y < extent.height(); ++y) {
    std::copy_n(part.row(y + extent.y0 - wide.y0) + extent.x0 - wide.x0, extent.width(),
                result.row(y));
  }
  return result;
}

/// As std::floor(), where the whole numbers are ints.
glm::ivec3 floored(const glm::dvec3& v) {
  const glm::ivec3 cut(v);
  return {cut.x - (v.x < cut.x ? 1 : 0), cut.y - (v.y < cut.y ? 1 : 0),
          cut.z - (v.z < cut.z ? 1 : 0)};
}

/// A voxel and the trust of its point: 21 bits per axis are 40 km at 2 cm.
std::uint64_t voxel_key(const CloudPoint& point, double voxel_m) {
  const glm::ivec3 voxel = floored(glm::dvec3(point.p_odom_m) / voxel_m);
  const auto part = [](int v) { return static_cast<std::uint64_t>(v + (1 << 20)) & 0x1FFFFF; };
  const std::uint64_t trusted = point.detection == ClassCloud::kTrusted ? 1 : 0;
  return trusted << 63 | part(voxel.x) << 42 | part(voxel.y) << 21 | part(voxel.z);
}

/// Wholly in the left or right third of the image and touching that side.
bool cut_by_side_edge(const Extent& extent, int width_px, const ClassCloudOptions& options) {
  const int left = extent.x0, right = extent.x1 - 1;
  const double third = options.edge_third * width_px, edge = options.edge_share * width_px;
  return (right < third && left < edge) ||
         (left >= width_px - third && right >= width_px - edge);
}

}  // namespace

ClassCloud::ClassCloud(const ClassCloudOptions& options, const VlfmRules& rules,
                       std::uint64_t seed)
    : options_(options), rules_(rules), random_(seed, "class_cloud") {
  SEGSIM_CHECK(options.voxel_m > 0.0 && options.max_depth_m > 0.0, "voxel_m, max_depth_m");
  SEGSIM_CHECK(options.max_points > 0 && options.cluster_min_points > 0, "point counts");
}

void ClassCloud::reset(std::uint64_t seed) {
  points_.clear();
  sources_.clear();
  fresh_m_.clear();
  voxels_.clear();
  changed_ = true;
  last_target_m_.reset();
  random_ = core::RandomStream(seed, "class_cloud");
  detections_ = 0;
}

std::uint64_t ClassCloud::new_id() {
  if (!rules_.published(Quirk::kFloatIds)) return ++detections_;
  // A random number in (0, 1) stands for the detection: rarely, two have the same.
  float id = 0.0F;
  while (!(id > 0.0F && id < 1.0F)) id = static_cast<float>(random_.uniform());
  return std::bit_cast<std::uint32_t>(id);
}

/// Points of the eroded mask in Odom; missing depth counts as the far end (as published), or
/// is left out (fixed Q8). @param corner_px  Where in the image the mask lies.
std::vector<glm::vec3> ClassCloud::masked_points(const core::Observation& observation,
                                                 const core::Image<std::uint8_t>& mask,
                                                 const glm::ivec2& corner_px) {
  const core::Image<float>& depth_m = *observation.depth_m;
  const auto far = static_cast<float>(options_.max_depth_m);
  const int holes_far = rules_.published(Quirk::kZeroDepth) ? 1 : 0;
  // Listed without a branch, which would be guessed wrong.
  if (pixels_.size() < mask.size()) pixels_.resize(mask.size());
  std::size_t count = 0;
  for (int y = 0; y < mask.height_px(); ++y) {
    const std::uint8_t* inside = mask.row(y);
    const float* depths = depth_m.row(y + corner_px.y) + corner_px.x;
    const auto first = static_cast<std::uint32_t>(y * mask.width_px());
    for (int x = 0; x < mask.width_px(); ++x) {
      pixels_[count] = first + static_cast<std::uint32_t>(x);
      count += static_cast<std::size_t>(static_cast<int>(inside[x] != 0) &
                                        (static_cast<int>(depths[x] > 0.0F) | holes_far));
    }
  }
  std::span<std::uint32_t> pixels(pixels_.data(), count);
  const auto most = static_cast<std::size_t>(options_.max_points);
  if (pixels.size() > most) {
    if (rules_.published(Quirk::kEndlessClouds)) {
      for (std::size_t k = 0; k < most; ++k) {  // A random subset: the head of a shuffle.
        const auto left = static_cast<std::uint32_t>(pixels.size() - k);
        std::swap(pixels[k], pixels[k + random_.index(left)]);
      }
    } else {
      for (std::size_t k = 0; k < most; ++k) pixels[k] = pixels[k * pixels.size() / most];
    }
    pixels = pixels.first(most);
  }
  const auto T = observation.T_odom_camera();
  const glm::dmat3 R = glm::mat3_cast(T.rotation());
  const double lowest_m = options_.floor_m > 0.0
                              ? observation.T_odom_robot.translation_m().z + options_.floor_m
                              : -1e18;
  std::vector<glm::vec3> points;
  points.reserve(pixels.size());
  const auto width = static_cast<std::uint32_t>(mask.width_px());
  for (const std::uint32_t pixel : pixels) {
    const int x = corner_px.x + static_cast<int>(pixel % width);
    const int y = corner_px.y + static_cast<int>(pixel / width);
    const float measured = depth_m(x, y);
    const double depth = static_cast<double>(measured > 0.0F ? std::min(measured, far) : far);
    const glm::dvec3 p =
        R * observation.intrinsics.back_project({x + 0.5, y + 0.5}, depth) + T.translation_m();
    if (p.z >= lowest_m) points.emplace_back(p);
  }
  return points;
}

bool ClassCloud::add(const core::Observation& observation,
                     const core::Image<std::uint8_t>& mask, const core::BoxPx& box) {
  SEGSIM_CHECK(observation.depth_m != nullptr && mask.size() == observation.depth_m->size(),
               "mask and depth differ in size");
  const double width_share = mask.width_px() / kImageWidth_px;
  const double area_share = static_cast<double>(mask.size()) / kImageArea_px2;
  const int passes = std::max(
      0, static_cast<int>(std::lround(options_.erosion_passes * std::min(width_share, 1.0))));
  const int min_points = std::max(3, static_cast<int>(std::lround(options_.cluster_min_points *
                                                                  std::min(area_share, 1.0))));
  const Extent extent = extent_of(mask);
  if (extent.empty()) return false;
  const std::vector<glm::vec3> cluster = largest_dbscan_cluster(
      masked_points(observation, eroded(mask, extent, passes), {extent.x0, extent.y0}),
      options_.cluster_eps_m, min_points);
  if (cluster.empty()) return false;

  const glm::dvec3 eye = observation.T_odom_camera().translation_m();
  const auto T_camera_odom = observation.T_odom_camera().inverse();
  // Roots and rotations are computed only where a rougher sum does not decide.
  constexpr double kRounding = 1e-6;
  const double too_close_m2 = options_.too_close_m * options_.too_close_m;
  const auto near = std::any_of(cluster.begin(), cluster.end(), [&](const glm::vec3& p) {
    const glm::dvec3 offset_m = glm::dvec3(p) - eye;
    return glm::dot(offset_m, offset_m) <= too_close_m2 + kRounding &&
           glm::distance(glm::dvec3(p), eye) < options_.too_close_m;
  });
  if (near) return false;
  glm::vec3 low = cluster.front(), high = low;
  for (const glm::vec3& p : cluster) {
    low = glm::min(low, p);
    high = glm::max(high, p);
  }
  fresh_m_.emplace_back(low, high);
  const auto source = static_cast<std::uint32_t>(sources_.size());
  sources_.push_back({observation.capture_index, box});
  const bool at_edge = cut_by_side_edge(extent, mask.width_px(), options_);
  const std::uint64_t second_class = new_id();
  const double trusted_m = options_.trusted_share * options_.max_depth_m;
  const glm::dvec3 axis = observation.T_odom_camera().rotation() * glm::dvec3(0.0, 0.0, 1.0);
  const auto trusted = [&](const glm::vec3& p) {
    if (at_edge) return false;
    const double about_m = glm::dot(axis, glm::dvec3(p) - eye);
    if (std::abs(about_m - trusted_m) > kRounding) return about_m < trusted_m;
    return (T_camera_odom * core::Point<core::frame::Odom>{glm::dvec3(p)}).xyz_m.z <=
           trusted_m;
  };
  for (const glm::vec3& p : cluster) {
    store({p, source, trusted(p) ? kTrusted : second_class});
  }
  if (points_.size() > options_.most_points) {  // The oldest go.
    std::size_t surplus = points_.size() - options_.most_points;
    erase([&](const CloudPoint&) { return surplus > 0 && surplus-- > 0; });
  }
  return true;
}

/// Fixed Q11: the first point of every voxel stays, for trusted and second-class points apart.
void ClassCloud::store(const CloudPoint& point) {
  if (rules_.published(Quirk::kEndlessClouds) ||
      voxels_.insert(voxel_key(point, options_.voxel_m))) {
    points_.push_back(point);
    changed_ = true;
  }
}

template <class Wrong>
void ClassCloud::erase(const Wrong& wrong) {
  const bool thinned = !rules_.published(Quirk::kEndlessClouds);
  const std::size_t erased = std::erase_if(points_, [&](const CloudPoint& point) {
    if (!wrong(point)) return false;
    if (thinned) voxels_.erase(voxel_key(point, options_.voxel_m));
    return true;
  });
  changed_ |= erased > 0;
}

void ClassCloud::carve(const core::Observation& observation,
                       std::span<const core::BoxPx> boxes) {
  const std::vector<std::pair<glm::vec3, glm::vec3>> fresh_m = std::exchange(fresh_m_, {});
  if (options_.carve_m <= 0.0 || fresh_m.empty()) return;
  const auto T_camera_odom = observation.T_odom_camera().inverse();
  const core::Image<float>& depth_m = *observation.depth_m;
  const auto reach_m = static_cast<float>(options_.carve_m);
  const auto covered = [&](const glm::vec2& px, float more_px) {
    return std::any_of(boxes.begin(), boxes.end(), [&](const core::BoxPx& box) {
      const float dx = std::max(kCarveMargin_px, kCarveMargin * box.width_px()) + more_px;
      const float dy = std::max(kCarveMargin_px, kCarveMargin * box.height_px()) + more_px;
      return px.x >= box.x0 - dx && px.x <= box.x1 + dx && px.y >= box.y0 - dy &&
             px.y <= box.y1 + dy;
    });
  };
  // Most points lie out of view or within a box, and a rougher sum sees that.
  const glm::dmat3 R = glm::mat3_cast(T_camera_odom.rotation());
  const glm::dvec3 eye = observation.T_odom_camera().translation_m();
  const core::CameraIntrinsics& camera = observation.intrinsics;
  const auto surely_right = [&](const glm::vec3& at) {
    constexpr double kRounding_m = 1e-6;
    constexpr float kRounding_px = 0.01F;
    const glm::dvec3 p = R * (glm::dvec3(at) - eye);
    if (p.z < kCarveNearest_m - kRounding_m) return true;
    if (p.z < kCarveNearest_m + kRounding_m) return false;
    const double per_z = 1.0 / p.z;
    const glm::vec2 px(camera.fx_px * p.x * per_z + camera.cx_px,
                       camera.fy_px * p.y * per_z + camera.cy_px);
    if (!(px.x >= -kRounding_px && px.y >= -kRounding_px &&
          px.x <= static_cast<float>(depth_m.width_px()) + kRounding_px &&
          px.y <= static_cast<float>(depth_m.height_px()) + kRounding_px)) {
      return true;
    }
    return covered(px, -kRounding_px);
  };
  const auto wrong = [&](const CloudPoint& point) {
    const glm::vec3& at = point.p_odom_m;
    const bool beside_fresh =
        std::any_of(fresh_m.begin(), fresh_m.end(), [&](const auto& extent) {
          return glm::all(glm::greaterThanEqual(at, extent.first - reach_m)) &&
                 glm::all(glm::lessThanEqual(at, extent.second + reach_m));
        });
    if (!beside_fresh || surely_right(at)) return false;
    const glm::dvec3 p =
        (T_camera_odom * core::Point<core::frame::Odom>{glm::dvec3(at)}).xyz_m;
    if (p.z < kCarveNearest_m) return false;
    const glm::vec2 px(observation.intrinsics.project(p));
    const int x = static_cast<int>(std::floor(px.x)), y = static_cast<int>(std::floor(px.y));
    if (!depth_m.contains(x, y) || covered(px, 0.0F)) return false;
    return std::abs(static_cast<double>(depth_m(x, y)) - p.z) < kCarveDepth_m;
  };
  erase(wrong);
}

void ClassCloud::refute_second_class(const core::Observation& observation) {
  const auto T_camera_odom = observation.T_odom_camera().inverse();
  const double range_m = options_.refute_share * options_.max_depth_m;
  const double half_rad = 0.5 * observation.intrinsics.horizontal_fov_rad();
  std::set<std::uint64_t> refuted;
  for (const CloudPoint& point : points_) {
    if (point.detection == kTrusted) continue;
    const glm::dvec3 p =
        (T_camera_odom * core::Point<core::frame::Odom>{glm::dvec3(point.p_odom_m)}).xyz_m;
    if (glm::length(p) <= range_m && std::abs(std::atan2(p.x, p.z)) <= half_rad) {
      refuted.insert(point.detection);
    }
  }
  if (refuted.empty()) return;
  erase([&](const CloudPoint& p) { return refuted.count(p.detection) != 0; });
}

void ClassCloud::erase_around(const glm::dvec2& place_m, double radius_m) {
  erase([&](const CloudPoint& point) {
    return glm::distance(glm::dvec2(point.p_odom_m), place_m) <= radius_m;
  });
  last_target_m_.reset();
}

}  // namespace segsim::nav
