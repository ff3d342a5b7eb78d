#pragma once

/// @file
/// A renderer of a few labelled boxes on a floor, by ray casting: exact and without any
/// library.

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <glm/geometric.hpp>

#include "core/render.h"

namespace segsim::sim {

struct LabelledBox {
  glm::dvec3 min_m, max_m;
  std::uint16_t class_id = 0, instance = 0;
};

class BoxRenderer final : public core::Renderer {
 public:
  explicit BoxRenderer(std::vector<LabelledBox> boxes) : boxes_(std::move(boxes)) {}
  using core::Renderer::render;

  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& camera,
              core::Channels /*channels*/, core::Frame& frame) override {
    const int w = camera.width_px;
    const int h = camera.height_px;
    frame.intrinsics = camera;
    frame.T_world_camera = T_world_camera;
    frame.rgb = core::Image<core::Rgb8>(w, h);
    frame.depth_m = core::Image<float>(w, h, std::numeric_limits<float>::quiet_NaN());
    frame.normal = core::Image<glm::vec3>(w, h, glm::vec3(0.0F));
    frame.alpha = core::Image<float>(w, h, 0.0F);
    frame.semantic = core::Image<std::uint16_t>(w, h, 0);
    frame.instance = core::Image<std::uint16_t>(w, h, 0);
    frame.confidence = core::Image<float>(w, h, 1.0F);
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        const glm::dvec3 ray =
            T_world_camera.rotation() * camera.back_project({x + 0.5, y + 0.5}, 1.0);
        shade(T_world_camera.translation_m(), ray, x, y, frame);
      }
    }
  }

 private:
  void shade(const glm::dvec3& eye, const glm::dvec3& ray, int x, int y,
             core::Frame& frame) const {
    double nearest = std::numeric_limits<double>::infinity();
    if (ray.z < 0.0) nearest = -eye.z / ray.z;
    const LabelledBox* hit = nullptr;
    for (const LabelledBox& box : boxes_) {
      double enter = 0.0;
      double leave = std::numeric_limits<double>::infinity();
      for (int axis = 0; axis < 3; ++axis) {
        const double a = (box.min_m[axis] - eye[axis]) / ray[axis];
        const double b = (box.max_m[axis] - eye[axis]) / ray[axis];
        enter = std::max(enter, std::min(a, b));
        leave = std::min(leave, std::max(a, b));
      }
      if (enter > 0.0 && enter < leave && enter < nearest) {
        nearest = enter;
        hit = &box;
      }
    }
    if (!std::isfinite(nearest)) return;
    frame.depth_m(x, y) = static_cast<float>(nearest);  // The ray has z = 1 in the camera.
    frame.alpha(x, y) = 1.0F;
    if (hit != nullptr) {
      frame.semantic(x, y) = hit->class_id;
      frame.instance(x, y) = hit->instance;
    }
  }

  std::vector<LabelledBox> boxes_;
};

}  // namespace segsim::sim
