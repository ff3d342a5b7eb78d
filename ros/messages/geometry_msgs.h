#pragma once

/// @file
/// Poses, velocities, transforms: m, m/s, rad/s, unit quaternions.

#include <array>
#include <string>

#include "ros/message_type.h"
#include "ros/messages/std_msgs.h"

namespace segsim::ros::geometry_msgs {

struct Vector3 {
  static constexpr MessageType kType{"geometry_msgs", "Vector3"};
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
  bool operator==(const Vector3&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("x", self.x);
    visit("y", self.y);
    visit("z", self.z);
  }
};

struct Point {
  static constexpr MessageType kType{"geometry_msgs", "Point"};
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
  bool operator==(const Point&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("x", self.x);
    visit("y", self.y);
    visit("z", self.z);
  }
};

struct Quaternion {
  static constexpr MessageType kType{"geometry_msgs", "Quaternion"};
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
  double w = 1.0;
  bool operator==(const Quaternion&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("x", self.x);
    visit("y", self.y);
    visit("z", self.z);
    visit("w", self.w);
  }
};

struct Pose {
  static constexpr MessageType kType{"geometry_msgs", "Pose"};
  Point position;
  Quaternion orientation;
  bool operator==(const Pose&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("position", self.position);
    visit("orientation", self.orientation);
  }
};

struct PoseStamped {
  static constexpr MessageType kType{"geometry_msgs", "PoseStamped"};
  std_msgs::Header header;
  Pose pose;
  bool operator==(const PoseStamped&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("header", self.header);
    visit("pose", self.pose);
  }
};

struct Pose2D {
  static constexpr MessageType kType{"geometry_msgs", "Pose2D"};
  double x = 0.0;
  double y = 0.0;
  double theta = 0.0;
  bool operator==(const Pose2D&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("x", self.x);
    visit("y", self.y);
    visit("theta", self.theta);
  }
};

/// Covariance of (x, y, z, rotations about them), row by row.
struct PoseWithCovariance {
  static constexpr MessageType kType{"geometry_msgs", "PoseWithCovariance"};
  Pose pose;
  std::array<double, 36> covariance{};
  bool operator==(const PoseWithCovariance&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("pose", self.pose);
    visit("covariance", self.covariance);
  }
};

struct Twist {
  static constexpr MessageType kType{"geometry_msgs", "Twist"};
  Vector3 linear;
  Vector3 angular;
  bool operator==(const Twist&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("linear", self.linear);
    visit("angular", self.angular);
  }
};

/// As in PoseWithCovariance.
struct TwistWithCovariance {
  static constexpr MessageType kType{"geometry_msgs", "TwistWithCovariance"};
  Twist twist;
  std::array<double, 36> covariance{};
  bool operator==(const TwistWithCovariance&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("twist", self.twist);
    visit("covariance", self.covariance);
  }
};

struct TwistStamped {
  static constexpr MessageType kType{"geometry_msgs", "TwistStamped"};
  std_msgs::Header header;
  Twist twist;
  bool operator==(const TwistStamped&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("header", self.header);
    visit("twist", self.twist);
  }
};

struct Transform {
  static constexpr MessageType kType{"geometry_msgs", "Transform"};
  Vector3 translation;
  Quaternion rotation;
  bool operator==(const Transform&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("translation", self.translation);
    visit("rotation", self.rotation);
  }
};

/// Re-expresses coordinates of the child in `header.frame_id`.
struct TransformStamped {
  static constexpr MessageType kType{"geometry_msgs", "TransformStamped"};
  std_msgs::Header header;
  std::string child_frame_id;
  Transform transform;
  bool operator==(const TransformStamped&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("header", self.header);
    visit("child_frame_id", self.child_frame_id);
    visit("transform", self.transform);
  }
};

}  // namespace segsim::ros::geometry_msgs
