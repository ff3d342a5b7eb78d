#pragma once

/// @file
/// Time.

#include <cstdint>

#include "ros/message_type.h"

namespace segsim::ros::builtin_interfaces {

/// Simulated time since the episode began, where this program writes it.
struct Time {
  static constexpr MessageType kType{"builtin_interfaces", "Time"};
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;
  bool operator==(const Time&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("sec", self.sec);
    visit("nanosec", self.nanosec);
  }
};

struct Duration {
  static constexpr MessageType kType{"builtin_interfaces", "Duration"};
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;
  bool operator==(const Duration&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("sec", self.sec);
    visit("nanosec", self.nanosec);
  }
};

}  // namespace segsim::ros::builtin_interfaces
