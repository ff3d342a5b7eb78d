#include "sim/gazebo/internal/model_track.h"

#include <cmath>

namespace segsim::sim::internal {

core::Pose2 pose_between(const ModelPose& a, const ModelPose& b, core::TimeNs stamp_ns) {
  const double share = static_cast<double>(stamp_ns - a.stamp_ns) /
                       static_cast<double>(b.stamp_ns - a.stamp_ns);
  const double turned_rad = core::wrap_angle_rad(b.pose.yaw_rad - a.pose.yaw_rad);
  return {a.pose.x_m + share * (b.pose.x_m - a.pose.x_m),
          a.pose.y_m + share * (b.pose.y_m - a.pose.y_m),
          core::wrap_angle_rad(a.pose.yaw_rad + share * turned_rad)};
}

ModelTrack::ModelTrack(const std::string& model) { model_.link_path = {model}; }

void ModelTrack::put(std::optional<core::TimeNs> stamp_ns,
                     std::span<const GazeboEntity> entities) {
  const CameraPoseResult found = camera_pose(entities, model_);
  const std::lock_guard lock(mutex_);
  if (!stamp_ns || found.fault != PoseFault::kNone) {
    last_fault_ = stamp_ns ? "a pose of '" + std::string(found.entity) + "' that is " +
                                 to_string(found.fault)
                           : "a message without time";
    if (stamp_ns && found.fault == PoseFault::kUnknownEntity) {
      last_fault_ = "poses of others than '" + model_.link_path.front() + "'";
    }
    return;
  }
  const glm::dquat rotation = found.T_world_camera.rotation();
  const glm::dvec3 ahead = rotation * glm::dvec3(1.0, 0.0, 0.0);
  const glm::dvec3 position_m = found.T_world_camera.translation_m();
  const ModelPose pose{*stamp_ns,
                       {position_m.x, position_m.y, std::atan2(ahead.y, ahead.x)},
                       position_m.z,
                       (rotation * glm::dvec3(0.0, 0.0, 1.0)).z};
  if (newest_ && pose.stamp_ns == newest_->stamp_ns) return;
  if (newest_ && pose.stamp_ns < newest_->stamp_ns) {
    ++restarts_;
    waiting_.clear();
  }
  newest_ = pose;
  waiting_.push_back(pose);
  if (waiting_.size() > kMost) waiting_.pop_front();
  arrived_.notify_all();
}

void ModelTrack::put_unreadable() {
  const std::lock_guard lock(mutex_);
  last_fault_ = "messages that are no poses";
}

std::optional<ModelPose> ModelTrack::wait_newer(core::TimeNs after_ns,
                                                std::chrono::milliseconds patience) {
  std::unique_lock lock(mutex_);
  const std::uint64_t restarts = restarts_;
  const auto there = [&] {
    return newest_ && (newest_->stamp_ns > after_ns || restarts_ != restarts);
  };
  if (!arrived_.wait_for(lock, patience, there)) return {};
  return newest_;
}

std::optional<ModelPose> ModelTrack::take(core::TimeNs after_ns,
                                          std::chrono::milliseconds patience) {
  std::unique_lock lock(mutex_);
  const auto there = [&] {
    while (!waiting_.empty() && waiting_.front().stamp_ns <= after_ns) waiting_.pop_front();
    return !waiting_.empty();
  };
  if (!arrived_.wait_for(lock, patience, there)) return {};
  const ModelPose pose = waiting_.front();
  waiting_.pop_front();
  return pose;
}

std::optional<ModelPose> ModelTrack::newest() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

std::uint64_t ModelTrack::restarts() const {
  const std::lock_guard lock(mutex_);
  return restarts_;
}

std::string ModelTrack::last_fault() const {
  const std::lock_guard lock(mutex_);
  return last_fault_;
}

}  // namespace segsim::sim::internal
