#pragma once

/// @file
/// What a rendered view is compared with. All losses are means over pixels, and tensors may be
/// on any device. Their derivatives do not depend on the number of threads.

#include "core/camera.h"
#include "core/frames.h"
#include "reconstruction/internal/tensors/tensors.h"
#include "reconstruction/training/training_config.h"

namespace segsim::reconstruction::internal {

/// Gaussian window of SSIM (11 x 11, sigma 1.5; Wang et al. 2004), zeros around the image.
/// @param image  [height, width, channels]. Differentiable.
[[nodiscard]] Tensor ssim_blur(const Tensor& image);

/// Structural similarity as 3DGS trains on: mean over pixels and channels, zero padded, values
/// in [0, 1].
[[nodiscard]] Tensor ssim(const Tensor& image, const Tensor& truth);

/// (1 - s) L1 + s (1 - SSIM)   (Kerbl et al. 2023).
/// @param valid  [height, width] bool, or undefined: pixels without it cost nothing.
[[nodiscard]] Tensor photometric_loss(const Tensor& rgb, const Tensor& truth,
                                      const Tensor& valid, double ssim_share);

/// Mean depth of the ray, sum / alpha; where alpha is small, what the division still gives.
[[nodiscard]] Tensor expected_depth(const Tensor& depth_sum_m, const Tensor& alpha);

/// Mean |expected depth - sensor| over pixels with alpha > 1/2 and a sensor depth in (min,
/// max); 0 without any.
/// @param sensor_m  [height, width], NaN = unknown.
/// @param weight  [height, width], > 0: the mean is a weighted one; undefined: all count
/// alike.
[[nodiscard]] Tensor depth_loss(const Tensor& depth_sum_m, const Tensor& alpha,
                                const Tensor& sensor_m, const Tensor& weight, double min_m,
                                double max_m);

/// Rays of a camera: [height, width, 3], z = 1, camera frame.
[[nodiscard]] Tensor camera_rays(const core::CameraIntrinsics& camera,
                                 const at::Device& device);

/// L_sdf of the paper on surfels: the mean distance of the sensor's points from the surfels'
/// planes, |sensor - expected depth| |n . ray|, with n the mean normal of the pixel. A point
/// farther than the truncation costs as much as one at it. Pixels as in depth_loss().
/// @param normal  [height, width, 3], world frame, sum of weight * normal.
[[nodiscard]] Tensor plane_loss(const Tensor& normal, const Tensor& depth_sum_m,
                                const Tensor& alpha, const Tensor& sensor_m,
                                const Tensor& rays, const core::CameraPose& T_world_camera,
                                const GeometryConfig::Loss& config);

/// Normal consistency of 2DGS (Huang et al. 2024, eq. 14): sum_k w_k (1 - n_k . n_d) with n_d
/// the normal of the expected depth, over inner pixels with alpha > 1/2; weights as they are.
/// @param normal  [height, width, 3], world frame, sum of weight * normal.
[[nodiscard]] Tensor normal_consistency(const Tensor& normal, const Tensor& depth_sum_m,
                                        const Tensor& alpha, const Tensor& rays,
                                        const core::CameraPose& T_world_camera);

}  // namespace segsim::reconstruction::internal
