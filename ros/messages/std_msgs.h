#pragma once

/// @file
/// Headers, texts, yes and no.

#include <string>

#include "ros/message_type.h"
#include "ros/messages/builtin_interfaces.h"

namespace segsim::ros::std_msgs {

struct Header {
  static constexpr MessageType kType{"std_msgs", "Header"};
  builtin_interfaces::Time stamp;
  std::string frame_id;
  bool operator==(const Header&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("stamp", self.stamp);
    visit("frame_id", self.frame_id);
  }
};

struct String {
  static constexpr MessageType kType{"std_msgs", "String"};
  std::string data;
  bool operator==(const String&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("data", self.data);
  }
};

struct Bool {
  static constexpr MessageType kType{"std_msgs", "Bool"};
  bool data = false;
  bool operator==(const Bool&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("data", self.data);
  }
};

struct ColorRGBA {
  static constexpr MessageType kType{"std_msgs", "ColorRGBA"};
  float r = 0.0F;
  float g = 0.0F;
  float b = 0.0F;
  float a = 0.0F;
  bool operator==(const ColorRGBA&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("r", self.r);
    visit("g", self.g);
    visit("b", self.b);
    visit("a", self.a);
  }
};

}  // namespace segsim::ros::std_msgs
