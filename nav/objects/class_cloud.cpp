#include "nav/objects/class_cloud.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <set>

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
constexpr float kSquare_m = 0.25F;  // The surroundings of a target are three of these wide.
constexpr double kCarveDepth_m = 0.15, kCarveNearest_m = 0.2;

using Square = std::pair<int, int>;

Square square_of(const CloudPoint& point) {
  return {static_cast<int>(std::floor(point.p_odom_m.x / kSquare_m)),
          static_cast<int>(std::floor(point.p_odom_m.y / kSquare_m))};
}

/// Of each square, the points in it and in the eight around it.
std::map<Square, int> counted_around(const std::map<Square, int>& counts) {
  std::map<Square, int> sums;
  for (const auto& [square, count] : counts) {
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) sums[{square.first + dx, square.second + dy}] += count;
    }
  }
  return sums;
}

/// Of each square, the number of its group; squares that touch, also by a corner, share one.
std::map<Square, std::size_t> grouped(const std::vector<CloudPoint>& points,
                                      std::size_t& groups) {
  constexpr auto kNone = static_cast<std::size_t>(-1);
  std::map<Square, std::size_t> group_of;
  for (const CloudPoint& point : points) group_of.try_emplace(square_of(point), kNone);
  groups = 0;
  for (auto& [first, group] : group_of) {
    if (group != kNone) continue;
    group = groups++;
    std::vector<Square> border{first};
    while (!border.empty()) {
      const Square at = border.back();
      border.pop_back();
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          const auto next = group_of.find({at.first + dx, at.second + dy});
          if (next == group_of.end() || next->second != kNone) continue;
          next->second = group;
          border.push_back(next->first);
        }
      }
    }
  }
  return group_of;
}

core::Image<std::uint8_t> eroded(const core::Image<std::uint8_t>& mask, int passes) {
  core::Image<std::uint8_t> result = mask;
  cv::Mat image(mask.height_px(), mask.width_px(), CV_8U, result.data());
  cv::erode(image, image, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}), {-1, -1}, passes);
  return result;
}

/// A voxel and the trust of its point: 21 bits per axis are 40 km at 2 cm.
std::uint64_t voxel_key(const CloudPoint& point, double voxel_m) {
  const glm::ivec3 voxel(glm::floor(glm::dvec3(point.p_odom_m) / voxel_m));
  const auto part = [](int v) { return static_cast<std::uint64_t>(v + (1 << 20)) & 0x1FFFFF; };
  const std::uint64_t trusted = point.detection == ClassCloud::kTrusted ? 1 : 0;
  return trusted << 63 | part(voxel.x) << 42 | part(voxel.y) << 21 | part(voxel.z);
}

/// Wholly in the left or right third of the image and touching that side.
bool cut_by_side_edge(const core::Image<std::uint8_t>& mask,
                      const ClassCloudOptions& options) {
  const int width = mask.width_px();
  int left = width, right = -1;
  for (int y = 0; y < mask.height_px(); ++y) {
    const std::uint8_t* row = mask.row(y);
    for (int x = 0; x < width; ++x) {
      if (row[x] == 0) continue;
      left = std::min(left, x);
      right = std::max(right, x);
    }
  }
  if (right < 0) return false;
  const double third = options.edge_third * width, edge = options.edge_share * width;
  return (right < third && left < edge) || (left >= width - third && right >= width - edge);
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
/// is left out (fixed Q8).
std::vector<glm::vec3> ClassCloud::masked_points(const core::Observation& observation,
                                                 const core::Image<std::uint8_t>& mask) {
  const core::Image<float>& depth_m = *observation.depth_m;
  const auto far = static_cast<float>(options_.max_depth_m);
  const bool holes_far = rules_.published(Quirk::kZeroDepth);
  std::vector<std::pair<int, int>> pixels;
  for (int y = 0; y < mask.height_px(); ++y) {
    for (int x = 0; x < mask.width_px(); ++x) {
      if (mask(x, y) != 0 && (depth_m(x, y) > 0.0F || holes_far)) pixels.emplace_back(x, y);
    }
  }
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
    pixels.resize(most);
  }
  const auto T = observation.T_odom_camera();
  const glm::dmat3 R = glm::mat3_cast(T.rotation());
  const double lowest_m = options_.floor_m > 0.0
                              ? observation.T_odom_robot.translation_m().z + options_.floor_m
                              : -1e18;
  std::vector<glm::vec3> points;
  points.reserve(pixels.size());
  for (const auto& [x, y] : pixels) {
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
  const std::vector<glm::vec3> cluster = largest_dbscan_cluster(
      masked_points(observation, eroded(mask, passes)), options_.cluster_eps_m, min_points);
  if (cluster.empty()) return false;

  const glm::dvec3 eye = observation.T_odom_camera().translation_m();
  const auto T_camera_odom = observation.T_odom_camera().inverse();
  const auto near = std::any_of(cluster.begin(), cluster.end(), [&](const glm::vec3& p) {
    return glm::distance(glm::dvec3(p), eye) < options_.too_close_m;
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
  const bool at_edge = cut_by_side_edge(mask, options_);
  const std::uint64_t second_class = new_id();
  const double trusted_m = options_.trusted_share * options_.max_depth_m;
  for (const glm::vec3& p : cluster) {
    const double forward_m =
        (T_camera_odom * core::Point<core::frame::Odom>{glm::dvec3(p)}).xyz_m.z;
    const bool trusted = !at_edge && forward_m <= trusted_m;
    store({p, source, trusted ? kTrusted : second_class});
  }
  if (points_.size() > options_.most_points) {  // The oldest go.
    points_.erase(points_.begin(),
                  points_.end() - static_cast<std::ptrdiff_t>(options_.most_points));
    recount_voxels();
  }
  return true;
}

/// Fixed Q11: the first point of every voxel stays, for trusted and second-class points apart.
void ClassCloud::store(const CloudPoint& point) {
  if (rules_.published(Quirk::kEndlessClouds) ||
      voxels_.insert(voxel_key(point, options_.voxel_m)).second) {
    points_.push_back(point);
  }
}

void ClassCloud::recount_voxels() {
  voxels_.clear();
  if (rules_.published(Quirk::kEndlessClouds)) return;
  for (const CloudPoint& point : points_) voxels_.insert(voxel_key(point, options_.voxel_m));
}

void ClassCloud::carve(const core::Observation& observation,
                       std::span<const core::BoxPx> boxes) {
  const std::vector<std::pair<glm::vec3, glm::vec3>> fresh_m = std::exchange(fresh_m_, {});
  if (options_.carve_m <= 0.0 || fresh_m.empty()) return;
  const auto T_camera_odom = observation.T_odom_camera().inverse();
  const core::Image<float>& depth_m = *observation.depth_m;
  const auto reach_m = static_cast<float>(options_.carve_m);
  const auto covered = [&](const glm::vec2& px) {
    return std::any_of(boxes.begin(), boxes.end(), [&](const core::BoxPx& box) {
      const float dx = std::max(kCarveMargin_px, kCarveMargin * box.width_px());
      const float dy = std::max(kCarveMargin_px, kCarveMargin * box.height_px());
      return px.x >= box.x0 - dx && px.x <= box.x1 + dx && px.y >= box.y0 - dy &&
             px.y <= box.y1 + dy;
    });
  };
  const auto wrong = [&](const CloudPoint& point) {
    const glm::vec3& at = point.p_odom_m;
    const bool beside_fresh =
        std::any_of(fresh_m.begin(), fresh_m.end(), [&](const auto& extent) {
          return glm::all(glm::greaterThanEqual(at, extent.first - reach_m)) &&
                 glm::all(glm::lessThanEqual(at, extent.second + reach_m));
        });
    if (!beside_fresh) return false;
    const glm::dvec3 p =
        (T_camera_odom * core::Point<core::frame::Odom>{glm::dvec3(at)}).xyz_m;
    if (p.z < kCarveNearest_m) return false;
    const glm::vec2 px(observation.intrinsics.project(p));
    const int x = static_cast<int>(std::floor(px.x)), y = static_cast<int>(std::floor(px.y));
    if (!depth_m.contains(x, y) || covered(px)) return false;
    return std::abs(static_cast<double>(depth_m(x, y)) - p.z) < kCarveDepth_m;
  };
  if (std::erase_if(points_, wrong) > 0) recount_voxels();
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
  std::erase_if(points_, [&](const CloudPoint& p) { return refuted.count(p.detection) != 0; });
  recount_voxels();
}

void ClassCloud::erase_around(const glm::dvec2& place_m, double radius_m) {
  std::erase_if(points_, [&](const CloudPoint& point) {
    return glm::distance(glm::dvec2(point.p_odom_m), place_m) <= radius_m;
  });
  recount_voxels();
  last_target_m_.reset();
}

std::vector<CloudGroup> ClassCloud::groups() const {
  std::size_t count = 0;
  const std::map<Square, std::size_t> group_of = grouped(points_, count);
  std::vector<CloudGroup> groups(count);
  std::vector<std::size_t> sizes(count, 0);
  std::vector<std::set<std::uint32_t>> sources(count);
  for (const CloudPoint& point : points_) {
    const std::size_t k = group_of.at(square_of(point));
    groups[k].center_m += glm::dvec2(point.p_odom_m);
    ++sizes[k];
    sources[k].insert(point.source);
  }
  for (std::size_t k = 0; k < count; ++k) {
    groups[k].center_m /= static_cast<double>(sizes[k]);
    for (const std::uint32_t source : sources[k]) {
      groups[k].made_of.push_back(sources_[source]);
    }
  }
  return groups;
}

/// The points, or the trusted ones, that ClassCloudOptions::support_share allows as targets.
std::vector<const CloudPoint*> ClassCloud::supported(bool trusted_only) const {
  std::vector<const CloudPoint*> points;
  points.reserve(points_.size());
  for (const CloudPoint& point : points_) {
    if (!trusted_only || point.detection == kTrusted) points.push_back(&point);
  }
  if (options_.support_share <= 0.0) return points;
  std::map<Square, int> counts;
  for (const CloudPoint* point : points) ++counts[square_of(*point)];
  const std::map<Square, int> around = counted_around(counts);
  int most = 0;
  for (const auto& [square, count] : counts) most = std::max(most, around.at(square));
  std::erase_if(points, [&](const CloudPoint* point) {
    return around.at(square_of(*point)) < options_.support_share * most;
  });
  return points;
}

std::optional<glm::dvec3> ClassCloud::target_m(const glm::dvec2& robot_m) {
  if (points_.empty()) {
    last_target_m_.reset();
    return std::nullopt;
  }
  const bool any_trusted =
      std::any_of(points_.begin(), points_.end(),
                  [](const CloudPoint& p) { return p.detection == kTrusted; });
  const CloudPoint* best = nullptr;
  double best_m = 1e18;
  for (const CloudPoint* point : supported(any_trusted)) {
    const double distance_m = glm::distance(glm::dvec2(point->p_odom_m), robot_m);
    if (distance_m < best_m) {
      best_m = distance_m;
      best = point;
    }
  }
  const glm::dvec3 now(best->p_odom_m);
  if (last_target_m_) {
    const double moved_m = glm::distance(glm::dvec2(now), glm::dvec2(*last_target_m_));
    if (moved_m < options_.keep_below_m ||
        (moved_m < options_.keep_far_below_m && best_m > options_.far_m)) {
      return last_target_m_;
    }
  }
  last_target_m_ = now;
  return last_target_m_;
}

}  // namespace segsim::nav
