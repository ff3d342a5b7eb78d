#include "core/camera.h"

#include <cmath>

#include "core/check.h"

namespace segsim::core {

CameraIntrinsics CameraIntrinsics::from_fov(int width_px, int height_px,
                                            double horizontal_fov_rad) {
  SEGSIM_CHECK(width_px > 0 && height_px > 0, "empty image");
  SEGSIM_CHECK(horizontal_fov_rad > 0.0 && horizontal_fov_rad < 3.141592653589793,
               "horizontal_fov_rad = " + std::to_string(horizontal_fov_rad));
  const double f_px = 0.5 * width_px / std::tan(0.5 * horizontal_fov_rad);
  return {width_px, height_px, f_px, f_px, 0.5 * width_px, 0.5 * height_px};
}

CameraIntrinsics CameraIntrinsics::resized(int new_width_px, int new_height_px) const {
  const double sx = static_cast<double>(new_width_px) / width_px;
  const double sy = static_cast<double>(new_height_px) / height_px;
  return {new_width_px, new_height_px, fx_px * sx, fy_px * sy, cx_px * sx, cy_px * sy};
}

double CameraIntrinsics::horizontal_fov_rad() const {
  return std::atan2(cx_px, fx_px) + std::atan2(width_px - cx_px, fx_px);
}

}  // namespace segsim::core
