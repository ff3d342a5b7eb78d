#include "experiments/scene_labels/internal/label_views.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/error.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/support/append_bytes.h"
#include "renderer/cpu_renderer.h"

namespace segsim::experiments::scene_labels::internal {
namespace {

constexpr int kJpegQuality = 90;

int between(int value, int low, int high) { return std::max(low, std::min(value, high)); }

}  // namespace

bool ViewRequest::operator==(const ViewRequest& other) const {
  if (width_px != other.width_px || camera != other.camera) return false;
  return camera || (free.p_m == other.free.p_m && free.yaw_rad == other.free.yaw_rad &&
                    free.pitch_down_rad == other.free.pitch_down_rad);
}

FreeCamera free_camera(const core::CameraPose& T_world_camera) {
  const glm::dvec3 forward = T_world_camera.rotation() * glm::dvec3(0.0, 0.0, 1.0);
  return {T_world_camera.translation_m(), std::atan2(forward.y, forward.x),
          -std::asin(std::clamp(forward.z, -1.0, 1.0))};
}

void LabelViews::set_scene(const scenes::SceneSurfels& scene) {
  renderer_ = renderer::make_cpu_renderer(scene.surfels, {}, scene.labels);
  drawn_.reset();
}

const core::Frame& LabelViews::frame(const ViewRequest& view) {
  if (drawn_ == view) return frame_;
  if (view.width_px < kNarrowest_px || view.width_px > kWidest_px) {
    throw core::InputError::expected(
        "width", std::to_string(kNarrowest_px) + " to " + std::to_string(kWidest_px) + " px",
        std::to_string(view.width_px));
  }
  core::CameraPose T_world_camera;
  core::CameraIntrinsics intrinsics;
  if (view.camera) {
    if (*view.camera >= cameras_.views.size()) {
      throw core::InputError::expected(
          "camera", "one of the recording's " + std::to_string(cameras_.views.size()),
          std::to_string(*view.camera));
    }
    T_world_camera = cameras_.views[*view.camera].T_world_camera;
    const core::CameraIntrinsics& whole = cameras_.intrinsics;
    const double scale = static_cast<double>(view.width_px) / whole.width_px;
    const auto height_px = static_cast<int>(std::lround(scale * whole.height_px));
    intrinsics = whole.resized(view.width_px, between(height_px, 8, 4 * kWidest_px));
  } else {
    T_world_camera = core::transform_from_pose2<core::frame::World>(
                         {view.free.p_m.x, view.free.p_m.y, view.free.yaw_rad}) *
                     core::mast_camera(view.free.p_m.z, view.free.pitch_down_rad);
    intrinsics = core::CameraIntrinsics::from_fov(view.width_px, view.width_px * 3 / 4,
                                                  kFreeFov_deg * std::numbers::pi / 180.0);
  }
  drawn_.reset();
  renderer_->render(T_world_camera, intrinsics,
                    core::Channels::kRgbd | core::Channels::kLabels, frame_);
  drawn_ = view;
  return frame_;
}

std::string LabelViews::jpeg(const ViewRequest& view) {
  return drawing::encoded(drawing::to_bgr(frame(view).rgb), ".jpg", kJpegQuality);
}

std::string LabelViews::ids(const ViewRequest& view) {
  const core::Frame& of = frame(view);
  std::string bytes;
  support::append_bytes(bytes, static_cast<std::uint32_t>(of.instance.width_px()));
  support::append_bytes(bytes, static_cast<std::uint32_t>(of.instance.height_px()));
  const std::size_t n = of.instance.size();
  for (std::size_t i = 0; i < n;) {
    const std::uint16_t instance = of.instance.data()[i], class_id = of.semantic.data()[i];
    std::size_t end = i;
    while (end < n && end - i < 65535 && of.instance.data()[end] == instance &&
           of.semantic.data()[end] == class_id) {
      ++end;
    }
    support::append_bytes(bytes, instance);
    support::append_bytes(bytes, class_id);
    support::append_bytes(bytes, static_cast<std::uint16_t>(end - i));
    i = end;
  }
  return bytes;
}

PickedPixel LabelViews::pick(const ViewRequest& view, int x_px, int y_px) {
  const core::Frame& of = frame(view);
  const int width = of.instance.width_px(), height = of.instance.height_px();
  if (x_px < 0 || y_px < 0 || x_px >= width || y_px >= height) {
    throw core::InputError::expected(
        "pixel", "one of " + std::to_string(width) + " x " + std::to_string(height),
        "(" + std::to_string(x_px) + ", " + std::to_string(y_px) + ")");
  }
  PickedPixel picked{of.semantic(x_px, y_px), of.instance(x_px, y_px), std::nullopt};
  const auto depth_m = static_cast<double>(of.depth_m(x_px, y_px));
  if (std::isfinite(depth_m)) {
    const core::Point<core::frame::Camera> p{
        of.intrinsics.back_project({x_px + 0.5, y_px + 0.5}, depth_m)};
    picked.p_m = (of.T_world_camera * p).xyz_m;
  }
  return picked;
}

}  // namespace segsim::experiments::scene_labels::internal
