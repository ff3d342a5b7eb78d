#include "reconstruction/datasets/pose_track.h"

#include <algorithm>
#include <utility>

#include <glm/common.hpp>
#include <glm/gtc/quaternion.hpp>

namespace segsim::reconstruction {

PoseTrack::PoseTrack(std::vector<Entry> entries) : entries_(std::move(entries)) {
  std::stable_sort(entries_.begin(), entries_.end(),
                   [](const Entry& a, const Entry& b) { return a.time_s < b.time_s; });
  entries_.erase(
      std::unique(entries_.begin(), entries_.end(),
                  [](const Entry& a, const Entry& b) { return a.time_s == b.time_s; }),
      entries_.end());
}

std::optional<core::CameraPose> PoseTrack::at(double time_s) const {
  const auto after =
      std::lower_bound(entries_.begin(), entries_.end(), time_s,
                       [](const Entry& entry, double t) { return entry.time_s < t; });
  if (after == entries_.end()) return std::nullopt;
  if (after->time_s == time_s) return after->T_world_camera;
  if (after == entries_.begin()) return std::nullopt;
  const Entry &a = *(after - 1), &b = *after;
  if (b.time_s - a.time_s > kWidestGap_s) return std::nullopt;
  const double share = (time_s - a.time_s) / (b.time_s - a.time_s);
  return core::CameraPose(
      glm::normalize(
          glm::slerp(a.T_world_camera.rotation(), b.T_world_camera.rotation(), share)),
      glm::mix(a.T_world_camera.translation_m(), b.T_world_camera.translation_m(), share));
}

}  // namespace segsim::reconstruction
