#pragma once

/// @file
/// Where a robot is, maps and paths.

#include <cstdint>
#include <string>
#include <vector>

#include "ros/message_type.h"
#include "ros/messages/builtin_interfaces.h"
#include "ros/messages/geometry_msgs.h"
#include "ros/messages/std_msgs.h"

namespace segsim::ros::nav_msgs {

/// Pose in `header.frame_id`, twist in `child_frame_id`.
struct Odometry {
  static constexpr MessageType kType{"nav_msgs", "Odometry"};
  std_msgs::Header header;
  std::string child_frame_id;
  geometry_msgs::PoseWithCovariance pose;
  geometry_msgs::TwistWithCovariance twist;
  bool operator==(const Odometry&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("header", self.header);
    visit("child_frame_id", self.child_frame_id);
    visit("pose", self.pose);
    visit("twist", self.twist);
  }
};

/// Resolution in m.
struct MapMetaData {
  static constexpr MessageType kType{"nav_msgs", "MapMetaData"};
  builtin_interfaces::Time map_load_time;
  float resolution = 0.0F;
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  geometry_msgs::Pose origin;
  bool operator==(const MapMetaData&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("map_load_time", self.map_load_time);
    visit("resolution", self.resolution);
    visit("width", self.width);
    visit("height", self.height);
    visit("origin", self.origin);
  }
};

/// Row by row from the origin: 0 to 100 per cent, -1 unknown.
struct OccupancyGrid {
  static constexpr MessageType kType{"nav_msgs", "OccupancyGrid"};
  std_msgs::Header header;
  MapMetaData info;
  std::vector<std::int8_t> data;
  bool operator==(const OccupancyGrid&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("header", self.header);
    visit("info", self.info);
    visit("data", self.data);
  }
};

struct Path {
  static constexpr MessageType kType{"nav_msgs", "Path"};
  std_msgs::Header header;
  std::vector<geometry_msgs::PoseStamped> poses;
  bool operator==(const Path&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("header", self.header);
    visit("poses", self.poses);
  }
};

}  // namespace segsim::ros::nav_msgs
