#pragma once

/// @file
/// A robot's RGB-D recording of ROS 2 (experiments/bags/bag_file.h) as a folder that
/// reconstructions are made of: the layout "tum" (reconstruction/datasets/tum.cpp).
///
///     colour      sensor_msgs/Image (rgb8, bgr8, rgba8, bgra8, mono8) or CompressedImage
///                 (JPEG, PNG)
///     depth       sensor_msgs/Image (16UC1 in mm, 32FC1 in m) or CompressedImage
///                 ("compressedDepth" with PNG, of 16UC1), in the colour camera's view
///     camera      sensor_msgs/CameraInfo: one camera, "plumb_bob" or no distortion
///     poses       /tf and /tf_static, from the fixed frame to the colour image's frame_id
///
/// Times are those of the headers' stamps. A colour image has the pose that is interpolated at
/// its stamp (experiments/bags/transform_tree.h); without one it is left out. It takes the
/// nearest depth image, at most 0.02 s away, which the layout "tum" sees to.

#include <cstddef>
#include <filesystem>
#include <string>

namespace segsim::experiments::bags {

struct UnpackOptions {
  std::string color_topic = "/camera/image_raw";
  std::string depth_topic = "/camera/depth/image_raw";
  std::string info_topic = "/camera/camera_info";
  /// In which the scene stands still, z up; empty: map, else odom, else the root of the tree.
  std::string fixed_frame;
};

struct UnpackSummary {
  std::size_t color_images = 0, depth_images = 0;
  std::size_t without_pose = 0;  ///< Colour images that were left out.
  std::string fixed_frame, camera_frame;
  std::string truncation;  ///< What is missing at the file's end; empty: nothing.
};

/// @param folder  Must not be there, or be one that this function made; it is replaced.
/// @throws core::InputError if the file is damaged, a topic is missing or of another type, an
/// encoding is not one of those above, or no image has a pose.
UnpackSummary unpack_recording(const std::filesystem::path& bag,
                               const std::filesystem::path& folder,
                               const UnpackOptions& options);

}  // namespace segsim::experiments::bags
