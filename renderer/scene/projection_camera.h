#pragma once

/// @file
/// From the camera of core/ to that of surfel_geometry.h.

#include <cmath>
#include <string>

#include <glm/gtc/quaternion.hpp>

#include "core/camera.h"
#include "core/check.h"
#include "core/frames.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::internal {

inline void check_intrinsics(const core::CameraIntrinsics& c) {
  SEGSIM_CHECK(
      c.width_px > 0 && c.height_px > 0 && c.width_px <= 65535 && c.height_px <= 65535,
      std::to_string(c.width_px) + " x " + std::to_string(c.height_px) + " pixels");
  SEGSIM_CHECK(std::isfinite(c.fx_px + c.fy_px + c.cx_px + c.cy_px),
               "intrinsics that are not finite");
  SEGSIM_CHECK(c.fx_px > 0.0 && c.fy_px > 0.0, "focal length " + std::to_string(c.fx_px) +
                                                   " " + std::to_string(c.fy_px) + " px");
}

template <class Real>
[[nodiscard]] ProjectionCamera<Real> projection_camera(const core::CameraPose& T_world_camera,
                                                       const core::CameraIntrinsics& c) {
  const glm::dmat3 R = glm::mat3_cast(glm::normalize(T_world_camera.rotation()));
  const glm::dvec3& p = T_world_camera.translation_m();
  const glm::dquat& q = T_world_camera.rotation();
  SEGSIM_CHECK(std::isfinite(p.x + p.y + p.z) && std::isfinite(q.w + q.x + q.y + q.z),
               "camera pose that is not finite");
  const auto vec = [](const glm::dvec3& v) {
    return Vec3<Real>{static_cast<Real>(v.x), static_cast<Real>(v.y), static_cast<Real>(v.z)};
  };
  return {vec(R[0]),
          vec(R[1]),
          vec(R[2]),
          vec(p),
          static_cast<Real>(c.fx_px),
          static_cast<Real>(c.fy_px),
          static_cast<Real>(c.cx_px),
          static_cast<Real>(c.cy_px)};
}

}  // namespace segsim::renderer::internal
