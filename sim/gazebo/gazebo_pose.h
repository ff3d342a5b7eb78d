#pragma once

/// @file
/// From the poses that Gazebo streams to the pose of a camera, and when a camera is due.
///
/// Gazebo's SceneBroadcaster sends all models, then all links, each relative to its parent,
/// with its bare name and its entity number; what belongs to what is not said. Names repeat
/// ("base_link" of every robot), but Gazebo numbers a model before its links and these before
/// the next model: a child is the entity of its name with the least number above its parent's.

#include <cstdint>
#include <span>
#include <string_view>

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

#include "core/frames.h"
#include "core/stages.h"
#include "sim/gazebo/gazebo_cameras.h"

namespace segsim::sim {

struct GazeboEntity {
  std::string_view name;
  std::uint32_t id = 0;  ///< 0 = not numbered: its place in the message counts instead.
  glm::dvec3 position_m{0.0};
  glm::dquat rotation{1.0, 0.0, 0.0, 0.0};
};

/// Why a message gives no camera pose.
enum class PoseFault : std::uint8_t {
  kNone,
  kUnreadable,     ///< Not a Pose_V message.
  kNoTime,         ///< No stamp, or one that is no time.
  kUnknownEntity,  ///< A model or link of the camera's mounting is missing.
  kNotFinite,      ///< NaN, infinity or a place beyond 10 000 km in its pose.
  kNotRotation,    ///< Quaternion not of length 1 to within 1e-3.
};
inline constexpr int kPoseFaults = 6;

/// In words, for counters.
[[nodiscard]] const char* to_string(PoseFault fault);

struct CameraPoseResult {
  PoseFault fault = PoseFault::kNone;
  std::string_view entity;  ///< Whose fault it is.
  core::CameraPose T_world_camera;
};

/// Only the entities of the camera's mounting are looked at.
[[nodiscard]] CameraPoseResult camera_pose(std::span<const GazeboEntity> entities,
                                           const GazeboCamera& camera);

/// What to do with a pose of a given time.
enum class PoseTiming : std::uint8_t {
  kDue,       ///< Draw it.
  kEarly,     ///< The camera is slower than the poses.
  kRepeated,  ///< Same time as before: Gazebo is paused.
};

/// A camera's clock, in simulated time: the first pose at or after every multiple of its
/// period is due, so that poses of 50 Hz serve 30 images a second on average, like Gazebo's
/// own sensors.
class CameraSchedule {
 public:
  /// @param rate_hz  0 = every pose.
  explicit CameraSchedule(double rate_hz);

  /// Poses in the order of their arrival. Time that goes back starts the clock anew.
  PoseTiming take(core::TimeNs stamp_ns);
  /// How often time went back: the world was reset, or another one came.
  [[nodiscard]] std::uint64_t restarts() const { return restarts_; }

 private:
  core::TimeNs period_ns_ = 0;
  core::TimeNs last_ns_ = -1;
  core::TimeNs due_ns_ = 0;
  std::uint64_t restarts_ = 0;
};

}  // namespace segsim::sim
