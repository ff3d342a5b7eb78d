#pragma once

/// @file
/// How the loss changes with the camera, from how it changes with the surfels: a camera that
/// moves and surfels that move the other way give the same images, so that no rasterizer needs
/// to know of poses.
///
///     surfels: p' = p + t + w x (p - c),  q' = (1, w/2) q,  and their colours turn along
///     dL/dt = sum_k g_p,   dL/dw = sum_k (p - c) x g_p + 1/2 (w g_v - g_w v + v x g_v) - s_k
///
/// with c the eye, (g_w, g_v) the derivative by the quaternion (w, v), and s_k the part of g_p
/// that comes from the direction of view, taken back because the colours turn too: a rotation
/// mixes the harmonics of a degree linearly. The camera's derivative is minus that.

#include <array>

#include "core/frames.h"
#include "reconstruction/training/internal/raster_function.h"

namespace segsim::reconstruction::internal {

/// Derivatives by a small motion of the camera in its own axes, T_world_camera * exp(motion).
struct CameraGradient {
  std::array<double, 3> translation{};  ///< [1/m]
  std::array<double, 3> rotation{};     ///< [1/rad]
};

/// @param surfels  Of a view that was drawn and differentiated; float or double.
/// @param gradients  Derivatives of the loss by them, the loss taken with the camera where it
///     is. What the loss asks of normals in the world frame moves with the camera.
/// @return  Exact, but for which surfels a pixel shows; sums in a fixed order.
[[nodiscard]] CameraGradient camera_gradient(const SurfelTensors& surfels,
                                             const SurfelTensors& gradients,
                                             const core::CameraPose& T_world_camera);

}  // namespace segsim::reconstruction::internal
