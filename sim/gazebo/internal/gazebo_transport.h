#pragma once

/// @file
/// Gazebo's transport and its messages of poses. Only files of the bridge and of the drive
/// include this: the transport's headers take the compiler several seconds.

#include <ignition/msgs/pose_v.pb.h>

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <ignition/transport/Node.hh>

#include "core/stages.h"
#include "sim/gazebo/gazebo_bridge.h"
#include "sim/gazebo/gazebo_pose.h"

namespace segsim::sim::internal {

/// A name of message types and the node that speaks it: one node cannot advertise a topic
/// twice.
struct Dialect {
  std::string prefix;  ///< "ignition.msgs." or "gz.msgs."
  ignition::transport::Node node;
};

/// One, or both. Sets the transport's environment, which it reads once, when the first node is
/// made.
[[nodiscard]] std::vector<std::unique_ptr<Dialect>> make_dialects(GazeboFlavour flavour);

/// A message of poses, read again and again without new memory.
class PoseMessage {
 public:
  /// @return  False if the bytes are no such message.
  [[nodiscard]] bool read(const char* bytes, std::size_t size);
  /// Empty: it has none, or one that is no time.
  [[nodiscard]] std::optional<core::TimeNs> stamp_ns() const;
  /// Names point into this object.
  [[nodiscard]] std::span<const GazeboEntity> entities() const { return entities_; }

 private:
  ignition::msgs::Pose_V message_;
  std::vector<GazeboEntity> entities_;
};

}  // namespace segsim::sim::internal
