#include "sim/gazebo/gazebo_pose.h"

#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <string>

#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::sim {
namespace {

constexpr double kLengthTolerance = 1e-3;
constexpr double kFarthest_m = 1e7;  // Renderers reckon in single precision.

/// Stamps are whole nanoseconds and periods are not: a pose this much too early is on time.
/// A fraction of the period, far below the 1 ms steps of Gazebo's physics at usual rates.
constexpr core::TimeNs kPartsOfPeriod = 100;

std::uint64_t number_of(std::span<const GazeboEntity> entities, std::size_t index) {
  return entities[index].id != 0 ? entities[index].id : index + 1;
}

/// The entity of a name with the least number above `after`; if all are below, the only one.
std::optional<std::size_t> find_child(std::span<const GazeboEntity> entities,
                                      std::string_view name, std::uint64_t after) {
  std::optional<std::size_t> best, any;
  std::uint64_t best_number = std::numeric_limits<std::uint64_t>::max();
  int matches = 0;
  for (std::size_t i = 0; i < entities.size(); ++i) {
    if (entities[i].name != name) continue;
    ++matches;
    any = i;
    const std::uint64_t number = number_of(entities, i);
    if (number > after && number < best_number) {
      best = i;
      best_number = number;
    }
  }
  return best || matches != 1 ? best : any;
}

PoseFault fault_of(const GazeboEntity& entity) {
  const glm::dquat& q = entity.rotation;
  for (const double value : {entity.position_m.x, entity.position_m.y, entity.position_m.z}) {
    if (!(std::abs(value) <= kFarthest_m)) return PoseFault::kNotFinite;
  }
  for (const double value : {q.w, q.x, q.y, q.z}) {
    if (!std::isfinite(value)) return PoseFault::kNotFinite;
  }
  const double length = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  return std::abs(length - 1.0) <= kLengthTolerance ? PoseFault::kNone
                                                    : PoseFault::kNotRotation;
}

}  // namespace

const char* to_string(PoseFault fault) {
  switch (fault) {
    case PoseFault::kNone:
      return "none";
    case PoseFault::kUnreadable:
      return "unreadable";
    case PoseFault::kNoTime:
      return "without time";
    case PoseFault::kUnknownEntity:
      return "without the camera's link";
    case PoseFault::kNotFinite:
      return "not finite";
    case PoseFault::kNotRotation:
      return "no unit quaternion";
  }
  return "";
}

CameraPoseResult camera_pose(std::span<const GazeboEntity> entities,
                             const GazeboCamera& camera) {
  CameraPoseResult result;
  core::Transform<core::frame::World, GazeboLinkFrame> T_world_link;
  std::uint64_t parent = 0;
  for (const std::string& name : camera.link_path) {
    const auto found = find_child(entities, name, parent);
    if (!found) return {PoseFault::kUnknownEntity, name, {}};
    const GazeboEntity& entity = entities[*found];
    if (const PoseFault fault = fault_of(entity); fault != PoseFault::kNone) {
      return {fault, name, {}};
    }
    const core::Transform<GazeboLinkFrame, GazeboLinkFrame> T_parent_child(
        glm::normalize(entity.rotation), entity.position_m);
    T_world_link = T_world_link * T_parent_child;
    parent = number_of(entities, *found);
  }
  result.T_world_camera = T_world_link * camera.T_link_camera;
  return result;
}

CameraSchedule::CameraSchedule(double rate_hz) {
  SEGSIM_CHECK(rate_hz >= 0.0, "negative rate");
  // Rounded down: a period a little too long would slip past a pose now and then.
  if (rate_hz > 0.0) period_ns_ = static_cast<core::TimeNs>(core::kNsPerSecond / rate_hz);
}

PoseTiming CameraSchedule::take(core::TimeNs stamp_ns) {
  if (stamp_ns == last_ns_) return PoseTiming::kRepeated;
  if (stamp_ns < last_ns_) {
    ++restarts_;
    due_ns_ = 0;
  }
  last_ns_ = stamp_ns;
  if (period_ns_ == 0) return PoseTiming::kDue;
  const core::TimeNs time_ns = stamp_ns + period_ns_ / kPartsOfPeriod;
  if (time_ns < due_ns_) return PoseTiming::kEarly;
  due_ns_ = (time_ns / period_ns_ + 1) * period_ns_;
  return PoseTiming::kDue;
}

}  // namespace segsim::sim
