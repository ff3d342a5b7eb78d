#include "core/frames.h"

#include "core/check.h"

namespace segsim::core {
namespace {

/// Rotation whose columns are the camera's axes right, down and forward.
glm::dquat rotation_from_axes(const glm::dvec3& right, const glm::dvec3& down,
                              const glm::dvec3& forward) {
  return glm::normalize(glm::quat_cast(glm::dmat3(right, down, forward)));
}

}  // namespace

Transform<frame::Robot, frame::Camera> mast_camera(double height_m, double pitch_down_rad,
                                                   double forward_m) {
  const double c = std::cos(pitch_down_rad);
  const double s = std::sin(pitch_down_rad);
  const glm::dvec3 right(0.0, -1.0, 0.0);
  const glm::dvec3 forward(c, 0.0, -s);
  const glm::dvec3 down(-s, 0.0, -c);
  return {rotation_from_axes(right, down, forward), {forward_m, 0.0, height_m}};
}

CameraPose look_at(const glm::dvec3& eye_m, const glm::dvec3& target_m) {
  const glm::dvec3 offset = target_m - eye_m;
  SEGSIM_CHECK(glm::length(offset) > 1e-9, "eye and target coincide");
  const glm::dvec3 forward = glm::normalize(offset);
  const glm::dvec3 up_hint =
      std::abs(forward.z) > 0.9999 ? glm::dvec3(0.0, 1.0, 0.0) : glm::dvec3(0.0, 0.0, 1.0);
  const glm::dvec3 right = glm::normalize(glm::cross(forward, up_hint));
  const glm::dvec3 down = glm::cross(forward, right);
  return {rotation_from_axes(right, down, forward), eye_m};
}

}  // namespace segsim::core
