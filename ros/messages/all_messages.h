#pragma once

/// @file
/// Every message that this program knows.

#include <tuple>

#include "ros/messages/builtin_interfaces.h"
#include "ros/messages/geometry_msgs.h"
#include "ros/messages/nav_msgs.h"
#include "ros/messages/rmw_dds_common.h"
#include "ros/messages/rosgraph_msgs.h"
#include "ros/messages/sensor_msgs.h"
#include "ros/messages/std_msgs.h"
#include "ros/messages/tf2_msgs.h"
#include "ros/messages/vision_msgs.h"

namespace segsim::ros {

using AllMessages =
    std::tuple<builtin_interfaces::Time, builtin_interfaces::Duration, std_msgs::Header,
               std_msgs::String, std_msgs::Bool, std_msgs::ColorRGBA, rosgraph_msgs::Clock,
               geometry_msgs::Vector3, geometry_msgs::Point, geometry_msgs::Quaternion,
               geometry_msgs::Pose, geometry_msgs::PoseStamped, geometry_msgs::Pose2D,
               geometry_msgs::PoseWithCovariance, geometry_msgs::Twist,
               geometry_msgs::TwistWithCovariance, geometry_msgs::TwistStamped,
               geometry_msgs::Transform, geometry_msgs::TransformStamped, tf2_msgs::TFMessage,
               nav_msgs::Odometry, nav_msgs::MapMetaData, nav_msgs::OccupancyGrid,
               nav_msgs::Path, sensor_msgs::Image, sensor_msgs::CompressedImage,
               sensor_msgs::RegionOfInterest, sensor_msgs::CameraInfo, sensor_msgs::LaserScan,
               sensor_msgs::Imu, sensor_msgs::NavSatStatus, sensor_msgs::NavSatFix,
               sensor_msgs::PointField, sensor_msgs::PointCloud2,
               vision_msgs::ObjectHypothesis, vision_msgs::ObjectHypothesisWithPose,
               vision_msgs::Point2D, vision_msgs::Pose2D, vision_msgs::BoundingBox2D,
               vision_msgs::Detection2D, vision_msgs::Detection2DArray, rmw_dds_common::Gid,
               rmw_dds_common::NodeEntitiesInfo, rmw_dds_common::ParticipantEntitiesInfo>;

}  // namespace segsim::ros
