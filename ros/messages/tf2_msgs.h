#pragma once

/// @file
/// Transforms between frames.

#include <vector>

#include "ros/message_type.h"
#include "ros/messages/geometry_msgs.h"

namespace segsim::ros::tf2_msgs {

struct TFMessage {
  static constexpr MessageType kType{"tf2_msgs", "TFMessage"};
  std::vector<geometry_msgs::TransformStamped> transforms;
  bool operator==(const TFMessage&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("transforms", self.transforms);
  }
};

}  // namespace segsim::ros::tf2_msgs
