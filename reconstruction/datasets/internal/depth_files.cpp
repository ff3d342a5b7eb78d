#include "reconstruction/datasets/internal/depth_files.h"

#include <algorithm>
#include <cmath>

#include "reconstruction/datasets/internal/reproject_depth.h"
#include "renderer/files/exr_io.h"

namespace segsim::reconstruction::internal {
namespace {

/// Depth as stored; empty if the frame has none.
core::Image<float> read_stored_depth(const FrameFiles& frame, double unit_m, double scale) {
  if (frame.depth_exr.empty() && frame.depth_png.empty()) return {};
  if (frame.depth_exr.empty()) return read_depth_image(frame.depth_png, unit_m * scale);
  core::Image<float> depth_m = renderer::read_depth_exr(frame.depth_exr);
  for (float& value : depth_m.pixels()) {
    value *= static_cast<float>(scale);
    if (!(value > 0.0F) || !std::isfinite(value)) value = std::nanf("");
  }
  return depth_m;
}

/// The image that `to` would have taken from the same place, by the nearest pixel; NaN where
/// `from` did not look.
core::Image<float> with_camera(const core::Image<float>& depth_m,
                               const core::CameraIntrinsics& from,
                               const core::CameraIntrinsics& to) {
  core::Image<float> result(to.width_px, to.height_px, std::nanf(""));
  for (int y = 0; y < to.height_px; ++y) {
    for (int x = 0; x < to.width_px; ++x) {
      const glm::dvec2 px = from.project(to.back_project({x + 0.5, y + 0.5}, 1.0));
      const int source_x = static_cast<int>(std::floor(px.x));
      const int source_y = static_cast<int>(std::floor(px.y));
      if (depth_m.contains(source_x, source_y)) result(x, y) = depth_m(source_x, source_y);
    }
  }
  return result;
}

/// The colour camera at about the size of the depth images, with the shape of its own.
core::CameraIntrinsics camera_for_depth(const core::CameraIntrinsics& color, int width_px,
                                        int height_px) {
  if (has_aspect_of(color, width_px, height_px)) return color.resized(width_px, height_px);
  const int width = std::min(width_px, color.width_px);
  const double height = static_cast<double>(width) * color.height_px / color.width_px;
  return color.resized(width, std::max(1, static_cast<int>(std::lround(height))));
}

}  // namespace

core::Image<float> read_depth(const FrameFiles& frame, const SequenceParts& parts) {
  core::Image<float> depth_m = read_stored_depth(frame, parts.depth_unit_m, parts.depth_scale);
  if (depth_m.empty() || parts.own_depth) return depth_m;
  const core::CameraIntrinsics color =
      camera_for_depth(parts.intrinsics, depth_m.width_px(), depth_m.height_px());
  const bool own_camera = parts.depth_camera.has_value();
  if (has_flying_pixels(parts.sensor)) {
    remove_flying_pixels(parts.sensor, own_camera ? *parts.depth_camera : color, depth_m);
  }
  if (parts.lens && !own_camera) {
    depth_m =
        Undistortion(*parts.lens, parts.intrinsics, depth_m.width_px(), depth_m.height_px())
            .nearest(depth_m);
  }
  if (parts.T_color_depth || frame.T_color_moved) {
    const CameraToCamera T_color_depth = frame.T_color_moved.value_or(CameraToCamera()) *
                                         parts.T_color_depth.value_or(CameraToCamera());
    return reproject_depth(depth_m, own_camera ? *parts.depth_camera : color, T_color_depth,
                           color);
  }
  return own_camera ? with_camera(depth_m, *parts.depth_camera, color) : depth_m;
}

}  // namespace segsim::reconstruction::internal
