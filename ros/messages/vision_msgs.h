#pragma once

/// @file
/// What detectors find (vision_msgs 4, of ROS 2 Humble and later).

#include <string>
#include <vector>

#include "ros/message_type.h"
#include "ros/messages/geometry_msgs.h"
#include "ros/messages/std_msgs.h"

namespace segsim::ros::vision_msgs {

struct ObjectHypothesis {
  static constexpr MessageType kType{"vision_msgs", "ObjectHypothesis"};
  std::string class_id;
  double score = 0.0;
  bool operator==(const ObjectHypothesis&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("class_id", self.class_id);
    visit("score", self.score);
  }
};

struct ObjectHypothesisWithPose {
  static constexpr MessageType kType{"vision_msgs", "ObjectHypothesisWithPose"};
  ObjectHypothesis hypothesis;
  geometry_msgs::PoseWithCovariance pose;
  bool operator==(const ObjectHypothesisWithPose&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("hypothesis", self.hypothesis);
    visit("pose", self.pose);
  }
};

struct Point2D {
  static constexpr MessageType kType{"vision_msgs", "Point2D"};
  double x = 0.0;
  double y = 0.0;
  bool operator==(const Point2D&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("x", self.x);
    visit("y", self.y);
  }
};

struct Pose2D {
  static constexpr MessageType kType{"vision_msgs", "Pose2D"};
  Point2D position;
  double theta = 0.0;
  bool operator==(const Pose2D&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("position", self.position);
    visit("theta", self.theta);
  }
};

/// px.
struct BoundingBox2D {
  static constexpr MessageType kType{"vision_msgs", "BoundingBox2D"};
  Pose2D center;
  double size_x = 0.0;
  double size_y = 0.0;
  bool operator==(const BoundingBox2D&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("center", self.center);
    visit("size_x", self.size_x);
    visit("size_y", self.size_y);
  }
};

struct Detection2D {
  static constexpr MessageType kType{"vision_msgs", "Detection2D"};
  std_msgs::Header header;
  std::vector<ObjectHypothesisWithPose> results;
  BoundingBox2D bbox;
  std::string id;
  bool operator==(const Detection2D&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("header", self.header);
    visit("results", self.results);
    visit("bbox", self.bbox);
    visit("id", self.id);
  }
};

struct Detection2DArray {
  static constexpr MessageType kType{"vision_msgs", "Detection2DArray"};
  std_msgs::Header header;
  std::vector<Detection2D> detections;
  bool operator==(const Detection2DArray&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("header", self.header);
    visit("detections", self.detections);
  }
};

}  // namespace segsim::ros::vision_msgs
