#pragma once

/// @file
/// Simulated time.

#include "ros/message_type.h"
#include "ros/messages/builtin_interfaces.h"

namespace segsim::ros::rosgraph_msgs {

struct Clock {
  static constexpr MessageType kType{"rosgraph_msgs", "Clock"};
  builtin_interfaces::Time clock;
  bool operator==(const Clock&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("clock", self.clock);
  }
};

}  // namespace segsim::ros::rosgraph_msgs
