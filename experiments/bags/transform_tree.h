#pragma once

/// @file
/// Where frames of a recording were in one another: the messages of /tf and /tf_static as a
/// tree. Between two messages poses are interpolated (positions linearly, rotations on the
/// great circle); before the first and behind the last there are none.

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

#include "ros/messages/builtin_interfaces.h"
#include "ros/messages/geometry_msgs.h"

namespace segsim::experiments::bags {

/// Of one frame in another.
struct RigidPose {
  glm::dquat rotation{1.0, 0.0, 0.0, 0.0};
  glm::dvec3 p_m{0.0};
  [[nodiscard]] RigidPose operator*(const RigidPose& inner) const {
    return {rotation * inner.rotation, rotation * inner.p_m + p_m};
  }
};

[[nodiscard]] std::int64_t nanoseconds(const ros::builtin_interfaces::Time& time);

class TransformTree {
 public:
  /// Poses that are further apart are not connected [ns].
  static constexpr std::int64_t kLongestGap_ns = 1'000'000'000;

  /// @param is_static  Holds at all times.
  /// @param place  For messages.
  /// @throws core::InputError for a rotation that is none, numbers that are not finite, or a
  /// frame with two parents.
  void add(const ros::geometry_msgs::TransformStamped& transform, bool is_static,
           const std::string& place);

  /// The frame itself, its parent, and so on to the root.
  /// @throws core::InputError if that never ends.
  [[nodiscard]] std::vector<std::string> ancestors(const std::string& frame) const;

  /// T_ancestor_frame; nothing if a pose on the way is not known at that time.
  /// @pre `ancestor` is one.
  [[nodiscard]] std::optional<RigidPose> find(const std::string& ancestor,
                                              const std::string& frame,
                                              std::int64_t time_ns) const;

 private:
  struct Link {
    std::string parent;
    bool is_static = false;
    std::map<std::int64_t, RigidPose> poses;  ///< T_parent_frame by time.
  };
  static std::optional<RigidPose> at(const Link& link, std::int64_t time_ns);

  std::map<std::string, Link> links_;  ///< By child.
};

}  // namespace segsim::experiments::bags
