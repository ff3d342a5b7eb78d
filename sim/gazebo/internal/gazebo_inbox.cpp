#include "sim/gazebo/internal/gazebo_inbox.h"

#include <algorithm>
#include <numeric>

namespace segsim::sim {

std::uint64_t GazeboTraffic::faults() const {
  return std::accumulate(faulty.begin(), faulty.end(), std::uint64_t{0});
}

namespace internal {
namespace {

bool same_view(const GazeboCamera& a, const GazeboCamera& b) {
  const core::CameraIntrinsics& i = a.intrinsics;
  const core::CameraIntrinsics& j = b.intrinsics;
  return a.link_path == b.link_path && a.rate_hz == b.rate_hz &&
         a.T_link_camera.rotation() == b.T_link_camera.rotation() &&
         a.T_link_camera.translation_m() == b.T_link_camera.translation_m() &&
         i.width_px == j.width_px && i.height_px == j.height_px && i.fx_px == j.fx_px &&
         i.fy_px == j.fy_px && i.cx_px == j.cx_px && i.cy_px == j.cy_px;
}

}  // namespace

std::vector<GazeboView> make_views(const std::vector<GazeboCamera>& cameras) {
  std::vector<GazeboView> views;
  for (const GazeboCamera& camera : cameras) {
    GazeboView* view = nullptr;
    for (GazeboView& known : views) {
      if (same_view(known.camera(), camera)) view = &known;
    }
    if (view == nullptr) view = &views.emplace_back();
    view->cameras.push_back(camera);
  }
  return views;
}

GazeboInbox::GazeboInbox(const std::vector<GazeboView>& views) {
  for (const GazeboView& view : views) {
    slots_.push_back({view.camera(), CameraSchedule(view.camera().rate_hz), {}});
  }
}

void GazeboInbox::put(std::optional<core::TimeNs> stamp_ns,
                      std::span<const GazeboEntity> entities, Clock::time_point arrival) {
  const std::lock_guard lock(mutex_);
  ++traffic_.poses;
  last_arrival_ = arrival;
  if (!stamp_ns) {
    count_fault(PoseFault::kNoTime, "expected a stamp in its header, found none");
    return;
  }
  traffic_.restarts = 0;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    Slot& slot = slots_[i];
    const CameraPoseResult pose = camera_pose(entities, slot.camera);
    if (pose.fault != PoseFault::kNone) {
      count_fault(pose.fault, "expected a pose of '" + std::string(pose.entity) + "', found " +
                                  (pose.fault == PoseFault::kUnknownEntity
                                       ? "none"
                                       : std::string("one that is ") + to_string(pose.fault)));
      continue;
    }
    // A faulty pose must not use up the turn of the next one: the schedule sees good ones
    // only.
    const PoseTiming timing = slot.schedule.take(*stamp_ns);
    if (timing == PoseTiming::kEarly) ++traffic_.early;
    if (timing == PoseTiming::kRepeated) ++traffic_.repeated;
    if (timing != PoseTiming::kDue) continue;
    if (slot.waiting.size() == kMostWaiting) {
      traffic_.superseded += slot.waiting.size();
      slot.waiting.clear();
    }
    slot.waiting.push_back({i, *stamp_ns, pose.T_world_camera, arrival});
    arrived_.notify_one();
  }
  for (const Slot& slot : slots_) {
    traffic_.restarts = std::max(traffic_.restarts, slot.schedule.restarts());
  }
}

void GazeboInbox::put_unreadable(std::size_t size_bytes) {
  const std::lock_guard lock(mutex_);
  ++traffic_.poses;
  count_fault(PoseFault::kUnreadable, "expected a Pose_V message, found " +
                                          std::to_string(size_bytes) + " other bytes");
}

void GazeboInbox::count_fault(PoseFault fault, const std::string& words) {
  ++traffic_.faulty[static_cast<std::size_t>(fault)];
  traffic_.last_fault = "pose message " + std::to_string(traffic_.poses) + ": " + words;
}

std::optional<GazeboInbox::Job> GazeboInbox::take(std::chrono::milliseconds patience) {
  std::unique_lock lock(mutex_);
  const auto oldest = [this] {
    Slot* found = nullptr;
    for (Slot& slot : slots_) {
      if (!slot.waiting.empty() && (found == nullptr || slot.waiting.front().arrival <
                                                            found->waiting.front().arrival)) {
        found = &slot;
      }
    }
    return found;
  };
  if (!arrived_.wait_for(lock, patience, [&] { return oldest() != nullptr; })) return {};
  std::deque<Job>& waiting = oldest()->waiting;
  const Job job = waiting.front();
  waiting.pop_front();
  return job;
}

void GazeboInbox::fill(GazeboStatus& status) const {
  const std::lock_guard lock(mutex_);
  status.traffic = traffic_;
  status.since_pose_s =
      last_arrival_ ? std::chrono::duration<double>(Clock::now() - *last_arrival_).count()
                    : -1.0;
}

}  // namespace internal
}  // namespace segsim::sim
