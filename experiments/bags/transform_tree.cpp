#include "experiments/bags/transform_tree.h"

#include <cmath>
#include <iterator>

#include "core/check.h"
#include "core/error.h"
#include "core/stages.h"

namespace segsim::experiments::bags {
namespace {

constexpr double kQuaternionTolerance = 1e-2;

RigidPose pose_of(const ros::geometry_msgs::Transform& transform, const std::string& place) {
  const auto& [x, y, z, w] = transform.rotation;
  const glm::dquat R(w, x, y, z);
  const glm::dvec3 p_m(transform.translation.x, transform.translation.y,
                       transform.translation.z);
  const double length = glm::length(R);
  const bool is_rotation = std::abs(length - 1.0) <= kQuaternionTolerance;
  if (!is_rotation || !std::isfinite(p_m.x + p_m.y + p_m.z)) {
    throw core::InputError::expected(place, "a unit quaternion and a finite position",
                                     "a quaternion of length " + std::to_string(length));
  }
  return {R / length, p_m};
}

}  // namespace

std::int64_t nanoseconds(const ros::builtin_interfaces::Time& time) {
  return time.sec * core::kNsPerSecond + time.nanosec;
}

void TransformTree::add(const ros::geometry_msgs::TransformStamped& transform, bool is_static,
                        const std::string& place) {
  const std::string& parent = transform.header.frame_id;
  const std::string& child = transform.child_frame_id;
  const auto [found, is_new] = links_.try_emplace(child, Link{parent, is_static, {}});
  Link& link = found->second;
  if (link.parent != parent || link.is_static != is_static) {
    throw core::InputError::expected(
        place, child + " in " + link.parent + (link.is_static ? ", static" : ", moving"),
        "in " + parent + (is_static ? ", static" : ", moving"));
  }
  const std::string what = place + ": " + child + " in " + parent;
  link.poses[is_static ? 0 : nanoseconds(transform.header.stamp)] =
      pose_of(transform.transform, what);
}

std::vector<std::string> TransformTree::ancestors(const std::string& frame) const {
  std::vector<std::string> chain = {frame};
  for (auto link = links_.find(frame); link != links_.end();
       link = links_.find(chain.back())) {
    chain.push_back(link->second.parent);
    if (chain.size() > links_.size() + 1) {
      throw core::InputError::expected("frame " + frame, "a tree of transforms",
                                       "a circle through " + chain.back());
    }
  }
  return chain;
}

std::optional<RigidPose> TransformTree::at(const Link& link, std::int64_t time_ns) {
  if (link.is_static) return link.poses.begin()->second;
  const auto after = link.poses.lower_bound(time_ns);
  if (after == link.poses.end()) return std::nullopt;
  if (after->first == time_ns) return after->second;
  if (after == link.poses.begin()) return std::nullopt;
  const auto before = std::prev(after);
  const std::int64_t gap_ns = after->first - before->first;
  if (gap_ns > kLongestGap_ns) return std::nullopt;
  const double share =
      static_cast<double>(time_ns - before->first) / static_cast<double>(gap_ns);
  const RigidPose& a = before->second;
  const RigidPose& b = after->second;
  return RigidPose{glm::slerp(a.rotation, b.rotation, share), a.p_m + share * (b.p_m - a.p_m)};
}

std::optional<RigidPose> TransformTree::find(const std::string& ancestor,
                                             const std::string& frame,
                                             std::int64_t time_ns) const {
  RigidPose T_here_frame;
  for (std::string here = frame; here != ancestor;) {
    const auto link = links_.find(here);
    SEGSIM_CHECK(link != links_.end(),
                 std::string(ancestor).append(" is no ancestor of ").append(frame));
    const std::optional<RigidPose> T_parent_here = at(link->second, time_ns);
    if (!T_parent_here) return std::nullopt;
    T_here_frame = *T_parent_here * T_here_frame;
    here = link->second.parent;
  }
  return T_here_frame;
}

}  // namespace segsim::experiments::bags
