#include "nav/objects/object_map.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

#include "core/check.h"
#include "nav/grid/robot_pose.h"
#include "nav/objects/internal/object_clusters.h"

namespace segsim::nav {
namespace {

constexpr double kDepthBin_m = 0.1;
constexpr double kDepthGap_m = 0.3;   // Empty depth that separates foreground and background.
constexpr double kNearShare = 0.25;   // The nearest layer with this share is the object.
constexpr double kTrim = 0.10;        // Quantile cut off each side: a box holds neighbours.
constexpr double kNearerView = 0.6;   // A view this much nearer replaces the cloud,
constexpr double kFartherView = 1.8;  // one this much farther adds no points.
constexpr std::size_t kVisibilitySamples = 24;
constexpr float kCarveMargin_px = 3.0F;  // A box is this uncertain, or
constexpr float kCarveMargin = 0.1F;     // by this share of its size.
constexpr double kCarveDepth_m = 0.15;   // A point is in view if the depth there agrees.

struct Samples {
  std::size_t looked_at = 0;  ///< Pixels, with or without depth.
  std::vector<glm::vec3> points_odom_m;
  std::vector<float> depths_m;
};

/// Valid depth pixels of the box's central part, at most about max_box_samples on a regular
/// grid.
Samples sample_box(const core::Observation& observation, const core::BoxPx& box,
                   const ObjectMapOptions& options) {
  const core::Image<float>& depth_m = *observation.depth_m;
  const auto shrink = static_cast<float>(0.5 * options.box_shrink);
  const float dx = shrink * box.width_px(), dy = shrink * box.height_px();
  const int x0 = std::max(0, static_cast<int>(std::floor(box.x0 + dx)));
  const int y0 = std::max(0, static_cast<int>(std::floor(box.y0 + dy)));
  const int x1 = std::min(depth_m.width_px(), static_cast<int>(std::ceil(box.x1 - dx)));
  const int y1 = std::min(depth_m.height_px(), static_cast<int>(std::ceil(box.y1 - dy)));
  Samples samples;
  if (x0 >= x1 || y0 >= y1) return samples;
  const double area = static_cast<double>(x1 - x0) * (y1 - y0);
  const int stride =
      std::max(1, static_cast<int>(std::ceil(std::sqrt(area / options.max_box_samples))));
  const auto T_odom_camera = observation.T_odom_camera();
  const glm::dmat3 R = glm::mat3_cast(T_odom_camera.rotation());
  const double floor_z_m = observation.T_odom_robot.translation_m().z + options.floor_height_m;
  for (int y = y0; y < y1; y += stride) {
    for (int x = x0; x < x1; x += stride) {
      ++samples.looked_at;
      const float depth = depth_m(x, y);
      if (!(depth > 0.0F) || static_cast<double>(depth) > options.max_range_m) continue;
      const glm::dvec3 p = R * observation.intrinsics.back_project({x + 0.5, y + 0.5}, depth) +
                           T_odom_camera.translation_m();
      if (p.z < floor_z_m) continue;
      samples.points_odom_m.emplace_back(p);
      samples.depths_m.push_back(depth);
    }
  }
  return samples;
}

/// Keeps the nearest depth layer that holds a good share of the samples: through the legs of a
/// chair the camera sees the wall, and the wall is not the chair.
void keep_depth_layer(Samples& samples, double max_range_m) {
  std::vector<std::size_t> histogram(static_cast<std::size_t>(max_range_m / kDepthBin_m) + 2,
                                     0);
  for (const float depth : samples.depths_m) {
    ++histogram[static_cast<std::size_t>(static_cast<double>(depth) / kDepthBin_m)];
  }
  const auto gap_bins = static_cast<std::size_t>(kDepthGap_m / kDepthBin_m);
  struct Layer {
    std::size_t first, last, count;
  };
  std::vector<Layer> layers;
  for (std::size_t k = 0; k < histogram.size(); ++k) {
    if (histogram[k] == 0) continue;
    if (layers.empty() || k - layers.back().last > gap_bins) layers.push_back({k, k, 0});
    layers.back().last = k;
    layers.back().count += histogram[k];
  }
  if (layers.empty()) return;
  const auto enough =
      static_cast<std::size_t>(kNearShare * static_cast<double>(samples.looked_at));
  auto chosen = std::find_if(layers.begin(), layers.end(),
                             [&](const Layer& layer) { return layer.count >= enough; });
  if (chosen == layers.end()) {
    chosen =
        std::max_element(layers.begin(), layers.end(),
                         [](const Layer& a, const Layer& b) { return a.count < b.count; });
  }
  Samples kept;
  kept.looked_at = samples.looked_at;
  for (std::size_t k = 0; k < samples.depths_m.size(); ++k) {
    const auto bin =
        static_cast<std::size_t>(static_cast<double>(samples.depths_m[k]) / kDepthBin_m);
    if (bin < chosen->first || bin > chosen->last) continue;
    kept.points_odom_m.push_back(samples.points_odom_m[k]);
    kept.depths_m.push_back(samples.depths_m[k]);
  }
  samples = std::move(kept);
}

void describe_cloud(MappedObject& object) {
  const std::size_t count = object.cloud_m.size();
  if (count == 0) return;
  const auto cut = static_cast<std::ptrdiff_t>(kTrim * static_cast<double>(count));
  std::vector<float> values(count);
  glm::dvec3 sum(0.0);
  for (const glm::vec3& p : object.cloud_m) sum += glm::dvec3(p);
  object.center_m = sum / static_cast<double>(count);
  for (int axis = 0; axis < 3; ++axis) {
    for (std::size_t k = 0; k < count; ++k) values[k] = object.cloud_m[k][axis];
    std::nth_element(values.begin(), values.begin() + cut, values.end());
    object.low_m[axis] = static_cast<double>(values[static_cast<std::size_t>(cut)]);
    const auto high = static_cast<std::ptrdiff_t>(count) - 1 - cut;
    std::nth_element(values.begin(), values.begin() + high, values.end());
    object.high_m[axis] = static_cast<double>(values[static_cast<std::size_t>(high)]);
  }
}

/// Removes points in plain view that project beside the object's box.
void carve(const core::Observation& observation, const core::BoxPx& box,
           std::vector<glm::vec3>& cloud_m) {
  const auto T_camera_odom = observation.T_odom_camera().inverse();
  const core::Image<float>& depth_m = *observation.depth_m;
  const float dx = std::max(kCarveMargin_px, kCarveMargin * box.width_px());
  const float dy = std::max(kCarveMargin_px, kCarveMargin * box.height_px());
  const auto beside = [&](const glm::vec3& point) {
    const glm::dvec3 p =
        (T_camera_odom * core::Point<core::frame::Odom>{glm::dvec3(point)}).xyz_m;
    if (p.z < 0.2) return false;
    const glm::vec2 px(observation.intrinsics.project(p));
    if (px.x >= box.x0 - dx && px.x <= box.x1 + dx && px.y >= box.y0 - dy &&
        px.y <= box.y1 + dy) {
      return false;
    }
    const int x = static_cast<int>(std::floor(px.x)), y = static_cast<int>(std::floor(px.y));
    return depth_m.contains(x, y) &&
           std::abs(static_cast<double>(depth_m(x, y)) - p.z) < kCarveDepth_m;
  };
  std::erase_if(cloud_m, beside);
}

}  // namespace

glm::dvec2 MappedObject::nearest_point_m(const glm::dvec2& place_m) const {
  glm::dvec2 best(center_m);
  double best_m = 1e18, best_m2 = 1e36;
  for (const glm::vec3& p : cloud_m) {
    const glm::dvec2 q(p.x, p.y);
    // A root is taken only where it may be the smaller one.
    const glm::dvec2 offset_m = place_m - q;
    const double distance_m2 = glm::dot(offset_m, offset_m);
    if (distance_m2 >= best_m2) continue;
    // Stray points beyond the trimmed extent do not count.
    if (q.x < low_m.x || q.y < low_m.y || q.x > high_m.x || q.y > high_m.y) continue;
    const double distance_m = std::sqrt(distance_m2);
    if (distance_m < best_m) {
      best_m = distance_m;
      best_m2 = distance_m2;
      best = q;
    }
  }
  return best;
}

double MappedObject::planar_distance_m(const glm::dvec2& place_m) const {
  return glm::distance(nearest_point_m(place_m), place_m);
}

LiftedDetection lift_detection(const core::Observation& observation,
                               const core::Detection& detection,
                               const ObjectMapOptions& options) {
  SEGSIM_CHECK(observation.depth_m != nullptr, "observation without depth");
  LiftedDetection lifted;
  lifted.score = detection.score;
  Samples samples = sample_box(observation, detection.box, options);
  keep_depth_layer(samples, options.max_range_m);
  // An object beyond the depth range is mostly holes; what depth there is belongs to others.
  if (static_cast<double>(samples.depths_m.size()) <
          kNearShare * static_cast<double>(samples.looked_at) ||
      samples.depths_m.empty()) {
    return lifted;
  }
  auto middle =
      samples.depths_m.begin() + static_cast<std::ptrdiff_t>(samples.depths_m.size() / 2);
  std::nth_element(samples.depths_m.begin(), middle, samples.depths_m.end());
  lifted.range_m = static_cast<double>(*middle);
  // Far away neighbouring pixels are farther apart than the gap.
  const double pixel_m = lifted.range_m / observation.intrinsics.fx_px;
  const double gap_m = std::max(options.cluster_distance_m, 4.0 * pixel_m);
  lifted.cloud_m =
      internal::largest_cluster(internal::thinned(samples.points_odom_m, options.voxel_m),
                                gap_m, options.min_cluster_points);
  if (lifted.cloud_m.empty()) return lifted;
  glm::dvec3 sum(0.0);
  for (const glm::vec3& p : lifted.cloud_m) sum += glm::dvec3(p);
  lifted.center_m = sum / static_cast<double>(lifted.cloud_m.size());
  return lifted;
}

namespace {

/// Whether a detection of another class says better what is seen there.
bool has_rival(const core::Detection& detection, std::span<const core::Detection> detections,
               double rival_iou) {
  return std::any_of(detections.begin(), detections.end(), [&](const core::Detection& other) {
    return other.class_index != detection.class_index && other.score > detection.score &&
           static_cast<double>(core::iou(other.box, detection.box)) >= rival_iou;
  });
}

}  // namespace

ObjectMap::ObjectMap(const ObjectMapOptions& options) : options_(options) {
  SEGSIM_CHECK(options.box_shrink >= 0.0 && options.box_shrink < 1.0, "box_shrink");
  SEGSIM_CHECK(options.voxel_m > 0.0 && options.max_range_m > 0.0, "voxel_m, max_range_m");
  SEGSIM_CHECK(options.max_box_samples > 0, "max_box_samples");
}

void ObjectMap::reset() {
  objects_.clear();
  last_hit_.clear();
  last_miss_.clear();
}

const MappedObject* ObjectMap::find(int id) const {
  return id >= 0 && static_cast<std::size_t>(id) < objects_.size()
             ? &objects_[static_cast<std::size_t>(id)]
             : nullptr;
}

double ObjectMap::view_weight(const ViewPose& last, const ViewPose& now) const {
  if (last.time_ns < 0) return 1.0;
  if (glm::distance(last.position_m, now.position_m) >= options_.min_move_m ||
      std::abs(core::wrap_angle_rad(last.yaw_rad - now.yaw_rad)) >= options_.min_turn_rad) {
    return 1.0;
  }
  return core::seconds(now.time_ns - last.time_ns) >= options_.min_repeat_s ? 0.5 : 0.0;
}

/// The object that a detection belongs to; a new one if it lies near none.
std::size_t ObjectMap::object_for(const LiftedDetection& lifted) {
  const glm::dvec2 place(lifted.center_m);
  std::size_t best = objects_.size();
  // Distances are uncertain far away.
  double best_m = options_.association_m * std::max(1.0, lifted.range_m / 3.0);
  for (std::size_t k = 0; k < objects_.size(); ++k) {
    const double distance_m = objects_[k].planar_distance_m(place);
    if (distance_m < best_m) {
      best_m = distance_m;
      best = k;
    }
  }
  if (best == objects_.size()) {
    objects_.emplace_back();
    objects_.back().id = static_cast<int>(best);
    last_hit_.emplace_back();
    last_miss_.emplace_back();
  }
  return best;
}

void ObjectMap::add_sighting(std::size_t index, const LiftedDetection& lifted,
                             const core::Observation& observation, const core::BoxPx& box,
                             const ViewPose& now) {
  MappedObject& object = objects_[index];
  object.last_seen_ns = now.time_ns;
  object.best_score = std::max(object.best_score, lifted.score);
  object.trusted = object.trusted || lifted.range_m <= options_.trusted_range_m;

  // The cloud comes from the nearest views.
  if (lifted.range_m < kNearerView * object.best_range_m) {
    object.cloud_m = lifted.cloud_m;
    object.made_of = {{observation.capture_index, box}};
    describe_cloud(object);
  } else if (lifted.range_m <= kFartherView * object.best_range_m) {
    carve(observation, box, object.cloud_m);
    if (object.cloud_m.size() < options_.max_cloud_points) {
      object.cloud_m.insert(object.cloud_m.end(), lifted.cloud_m.begin(),
                            lifted.cloud_m.end());
      object.cloud_m = internal::thinned(object.cloud_m, options_.voxel_m);
      object.made_of.push_back({observation.capture_index, box});
    }
    describe_cloud(object);
  }
  object.best_range_m = std::min(object.best_range_m, lifted.range_m);

  const double weight = view_weight(last_hit_[index], now);
  if (weight > 0.0) {
    object.sightings += weight;
    object.score_sum += weight * static_cast<double>(lifted.score);
    last_hit_[index] = now;
  }
}

/// Views that should have shown an object and did not: in the image, near, not hidden.
void ObjectMap::count_misses(const core::Observation& observation, const ViewPose& now,
                             const std::vector<bool>& seen_now) {
  const auto T_camera_odom = observation.T_odom_camera().inverse();
  for (std::size_t k = 0; k < objects_.size(); ++k) {
    MappedObject& object = objects_[k];
    if (seen_now[k] || object.status == ObjectStatus::kRefuted || object.cloud_m.empty())
      continue;
    if (object.planar_distance_m(now.position_m) > options_.refute_range_m) continue;
    const std::size_t stride =
        std::max<std::size_t>(1, object.cloud_m.size() / kVisibilitySamples);
    std::size_t visible = 0, looked_at = 0;
    for (std::size_t n = 0; n < object.cloud_m.size(); n += stride, ++looked_at) {
      const glm::dvec3 p =
          (T_camera_odom * core::Point<core::frame::Odom>{glm::dvec3(object.cloud_m[n])})
              .xyz_m;
      if (p.z < 0.2) continue;
      const glm::dvec2 px = observation.intrinsics.project(p);
      const int x = static_cast<int>(std::floor(px.x)), y = static_cast<int>(std::floor(px.y));
      if (!observation.depth_m->contains(x, y)) continue;
      const auto depth = static_cast<double>((*observation.depth_m)(x, y));
      if (depth > p.z - options_.occlusion_margin_m) ++visible;  // False for NaN.
    }
    if (static_cast<double>(visible) <
        options_.visible_share * static_cast<double>(looked_at)) {
      continue;
    }
    const double weight = view_weight(last_miss_[k], now);
    if (weight <= 0.0) continue;
    object.misses += weight;
    last_miss_[k] = now;
  }
}

void ObjectMap::update_status(MappedObject& object) const {
  if (object.status == ObjectStatus::kRefuted) {
    if (object.times_refuted > 1 ||
        object.sightings - object.sightings_at_refute < options_.revive_sightings) {
      return;
    }
    object.status = ObjectStatus::kTentative;
    object.misses = 0.0;
  }
  if (object.misses > options_.refute_ratio * object.sightings + options_.refute_margin) {
    object.status = ObjectStatus::kRefuted;
    object.sightings_at_refute = object.sightings;
    ++object.times_refuted;
  } else if (object.trusted && object.sightings >= options_.confirm_sightings &&
             object.score_sum >= options_.confirm_score_sum) {
    object.status = ObjectStatus::kConfirmed;
  }
}

void ObjectMap::refute(int id) {
  SEGSIM_CHECK(find(id) != nullptr, "object " + std::to_string(id));
  MappedObject& object = objects_[static_cast<std::size_t>(id)];
  object.status = ObjectStatus::kRefuted;
  object.sightings_at_refute = object.sightings;
  ++object.times_refuted;
}

void ObjectMap::update(const core::Observation& observation,
                       std::span<const core::Detection> detections, int class_index) {
  SEGSIM_CHECK(observation.depth_m != nullptr, "observation without depth");
  const ViewPose now{glm::dvec2(observation.T_odom_robot.translation_m()),
                     pose_of(observation.T_odom_robot).yaw_rad, observation.capture_time_ns};
  std::vector<bool> seen_now(objects_.size(), false);
  for (const core::Detection& detection : detections) {
    if (detection.class_index != class_index || class_index < 0) continue;
    if (options_.rival_iou < 1.0 && has_rival(detection, detections, options_.rival_iou))
      continue;
    const LiftedDetection lifted = lift_detection(observation, detection, options_);
    if (lifted.cloud_m.empty()) continue;
    const std::size_t index = object_for(lifted);
    seen_now.resize(objects_.size(), false);
    if (!seen_now[index])
      // The best box of an object counts.
      add_sighting(index, lifted, observation, detection.box, now);
    seen_now[index] = true;
  }
  count_misses(observation, now, seen_now);
  for (MappedObject& object : objects_) update_status(object);
}

}  // namespace segsim::nav
