#pragma once

/// @file
/// Between the transport's thread and the one that draws: the due poses of each view. A few
/// may wait, so that a short stall of the machine costs no frame; if more come, only the
/// newest stays, so that a renderer that is too slow does not fall behind.

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/frames.h"
#include "core/stages.h"
#include "sim/gazebo/gazebo_bridge.h"
#include "sim/gazebo/gazebo_pose.h"

namespace segsim::sim::internal {

/// Cameras that see the same picture.
struct GazeboView {
  std::vector<GazeboCamera> cameras;  ///< At least one; the first stands for all.
  [[nodiscard]] const GazeboCamera& camera() const { return cameras.front(); }
};

/// Groups cameras with equal mounting, intrinsics and rate, in the order of their first.
[[nodiscard]] std::vector<GazeboView> make_views(const std::vector<GazeboCamera>& cameras);

class GazeboInbox {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::size_t kMostWaiting = 3;  ///< Of each view.
  struct Job {
    std::size_t view = 0;
    core::TimeNs stamp_ns = 0;
    core::CameraPose T_world_camera;
    Clock::time_point arrival;
  };

  explicit GazeboInbox(const std::vector<GazeboView>& views);

  /// One message, from any thread.
  /// @param stamp_ns  Empty: it had none.
  void put(std::optional<core::TimeNs> stamp_ns, std::span<const GazeboEntity> entities,
           Clock::time_point arrival);
  /// A message that could not be read.
  void put_unreadable(std::size_t size_bytes);
  /// The pose that waits longest; empty if none came within `patience`.
  [[nodiscard]] std::optional<Job> take(std::chrono::milliseconds patience);

  /// The counters of this side; `since_pose_s` too.
  void fill(GazeboStatus& status) const;

 private:
  void count_fault(PoseFault fault, const std::string& words);

  struct Slot {
    GazeboCamera camera;
    CameraSchedule schedule;
    std::deque<Job> waiting;  ///< Oldest first.
  };
  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::vector<Slot> slots_;
  GazeboTraffic traffic_;
  std::optional<Clock::time_point> last_arrival_;
};

}  // namespace segsim::sim::internal
