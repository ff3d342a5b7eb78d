#pragma once

/// @file
/// The cameras that a Gazebo world describes: where they are mounted and on which topics a
/// Gazebo sensor would publish. Read from the world's SDF file, because a running Gazebo
/// streams the poses of models and links alone.
///
///     world <- model <- ... <- link <- sensor (x forward, y left, z up) <- optical frame
///     |----- streamed, by name -----|-------------- T_link_camera -------------|
///
/// Names follow gz-sim and gz-sensors (RenderUtil, CameraSensor, RgbdCameraSensor,
/// DepthCameraSensor, SegmentationCameraSensor of Fortress to Harmonic):
///
///     sensor type    | images                                    | camera info
///     camera         | T; default S/image                        | camera_info in place of
///     T's last word depth_camera   | T; default S/depth_image                  | the same
///     rgbd_camera    | T/image, T/depth_image; default T = S     | T/camera_info
///     segmentation   | T/labels_map, T/colored_map;              | T/camera_info
///                    | default T = S/segmentation                |
///
/// with T the sensor's `<topic>` and S = /world/W/model/M/link/L/sensor/N.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/frames.h"

namespace segsim::sim {

/// A link as Gazebo streams it.
struct GazeboLinkFrame;

/// What the three bytes of a labels map mean.
enum class GazeboLabels : std::uint8_t {
  kSemantic,  ///< The label in all three.
  kPanoptic,  ///< count mod 256, count / 256, label; counts start at 1 for each label.
};

struct GazeboCamera {
  std::string frame_id;  ///< Scoped sensor name, for example "jackal::base_link::front".
  /// Names from the outermost model to the link; empty: fixed in the world.
  std::vector<std::string> link_path;
  /// With an empty path this is T_world_camera.
  core::Transform<GazeboLinkFrame, core::frame::Camera> T_link_camera;
  core::CameraIntrinsics intrinsics;
  double rate_hz = 0.0;  ///< In simulated time; 0 = every pose.
  double near_m = 0.0, far_m = 0.0;
  GazeboLabels labels = GazeboLabels::kSemantic;
  /// Absolute topic names; empty = this camera has no such image.
  std::string rgb_topic, depth_topic, labels_topic, colored_topic, info_topic;
};

struct GazeboCameras {
  std::string world;
  std::vector<GazeboCamera> cameras;  ///< In the order of the file.
  /// Properties that the images will not have, such as lens distortion.
  std::vector<std::string> warnings;
};

/// @throws core::InputError: no such file, no world in it, no camera, or one whose mounting,
///     size or field of view makes no sense.
[[nodiscard]] GazeboCameras read_gazebo_cameras(const std::filesystem::path& world_file);
/// The same from the text of an SDF file. @param place  For messages.
[[nodiscard]] GazeboCameras parse_gazebo_cameras(const std::string& sdf_text,
                                                 const std::string& place);

}  // namespace segsim::sim
