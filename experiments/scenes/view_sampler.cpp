#include "experiments/scenes/view_sampler.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include "core/error.h"
#include "sim/trial/episode_sampling.h"

namespace segsim::experiments::scenes {

bool ViewDistance::alike(const core::Pose2& a, const core::Pose2& b) const {
  return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m) < distance_m &&
         std::abs(core::wrap_angle_rad(a.yaw_rad - b.yaw_rad)) < angle_rad;
}

ViewSampler::ViewSampler(const sim::World& world,
                         std::span<const core::SceneClass> scene_classes,
                         std::span<const std::string> class_names,
                         const ViewSamplerOptions& options)
    : options_(options), random_(options.seed, "label_views") {
  const sim::FreeSpace& space = world.free_space();
  for (int y = 0; y < space.island.height_px(); ++y) {
    for (int x = 0; x < space.island.width_px(); ++x) {
      if (space.island(x, y) != 1) continue;
      const glm::dvec2 p_m = space.frame.center_m(x, y);
      if (!is_avoided({p_m.x, p_m.y, 0.0})) cells_.push_back(p_m);
    }
  }
  if (cells_.empty()) {
    throw core::InputError::expected(
        world.manifest().name, "room for the robot",
        options_.avoid_m.empty() ? "none" : "none outside the avoided circles");
  }
  for (const core::SceneInstance& instance : world.manifest().instances) {
    for (const core::SceneClass& scene_class : scene_classes) {
      if (scene_class.id != instance.class_id) continue;
      if (std::find(class_names.begin(), class_names.end(), scene_class.name) !=
          class_names.end()) {
        objects_by_class_[instance.class_id].push_back(&instance);
      }
    }
  }
}

ViewSampler::View ViewSampler::next() {
  const glm::dvec2 p_m = cells_[random_.index(static_cast<std::uint32_t>(cells_.size()))];
  core::Pose2 pose{p_m.x, p_m.y, random_.uniform(-std::numbers::pi, std::numbers::pi)};
  if (objects_by_class_.empty() || !random_.chance(options_.share_facing_object)) {
    return {pose};
  }
  // A class first, then one of its objects: frequent classes would dominate otherwise.
  auto entry = objects_by_class_.begin();
  std::advance(entry, random_.index(static_cast<std::uint32_t>(objects_by_class_.size())));
  const core::SceneInstance& object =
      *entry->second[random_.index(static_cast<std::uint32_t>(entry->second.size()))];
  const glm::dvec3 centre = 0.5 * (object.box_min_m + object.box_max_m);
  for (int attempt = 0; attempt < 40; ++attempt) {
    const glm::dvec2 q_m = cells_[random_.index(static_cast<std::uint32_t>(cells_.size()))];
    if (std::hypot(q_m.x - centre.x, q_m.y - centre.y) > options_.max_object_distance_m) {
      continue;
    }
    pose = sim::facing(q_m, object.box_min_m, object.box_max_m);
    pose.yaw_rad = core::wrap_angle_rad(pose.yaw_rad + random_.uniform(-0.4, 0.4));
    return {pose, object.id};
  }
  return {pose};
}

bool ViewSampler::is_near_duplicate(const core::Pose2& pose) const {
  return std::any_of(accepted_.begin(), accepted_.end(), [&](const core::Pose2& other) {
    return options_.near_duplicate.alike(pose, other);
  });
}

bool ViewSampler::is_avoided(const core::Pose2& pose) const {
  return std::any_of(
      options_.avoid_m.begin(), options_.avoid_m.end(), [&](const glm::dvec2& p_m) {
        return std::hypot(pose.x_m - p_m.x, pose.y_m - p_m.y) < options_.avoid_radius_m;
      });
}

}  // namespace segsim::experiments::scenes
