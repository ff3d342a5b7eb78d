#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

namespace segsim::core {

/// Pinhole camera without distortion: x_px = f_px * (X/Z, Y/Z) + c_px, where pixel (i, j) has
/// its centre at (i + 0.5, j + 0.5). A calibration whose pixel centres are integers (OpenCV,
/// COLMAP's dense tools, the HoloLens files) needs +0.5 on c_px: loaders add it.
struct CameraIntrinsics {
  int width_px = 0, height_px = 0;
  double fx_px = 0.0, fy_px = 0.0;
  double cx_px = 0.0, cy_px = 0.0;

  /// Principal point in the image centre. @param horizontal_fov_rad in (0, pi).
  [[nodiscard]] static CameraIntrinsics from_fov(int width_px, int height_px,
                                                 double horizontal_fov_rad);
  /// The same camera with images of another size.
  [[nodiscard]] CameraIntrinsics resized(int new_width_px, int new_height_px) const;
  [[nodiscard]] double horizontal_fov_rad() const;

  /// Camera coordinates of the point at `depth_m` (along +z) seen at image position `px`.
  [[nodiscard]] glm::dvec3 back_project(const glm::dvec2& px, double depth_m) const {
    return {(px.x - cx_px) / fx_px * depth_m, (px.y - cy_px) / fy_px * depth_m, depth_m};
  }
  /// Image position of a camera point with z > 0.
  [[nodiscard]] glm::dvec2 project(const glm::dvec3& p_camera_m) const {
    return {fx_px * p_camera_m.x / p_camera_m.z + cx_px,
            fy_px * p_camera_m.y / p_camera_m.z + cy_px};
  }
};

}  // namespace segsim::core
