#pragma once

/// @file
/// What training changes: surfels as unconstrained numbers, the way the official 2DGS
/// checkpoints store them (Huang et al. 2024), and images as the loss sees them. Plain
/// pointers, so that the CPU rasterizer, the CUDA rasterizer and libtorch share them without
/// copies; all arrays are contiguous, row-major, in the memory of the rasterizer that reads
/// them.

#include <cstdint>

namespace segsim::reconstruction {

/// Parameters of `count` surfels. Real is float in training, double in gradient checks.
template <class Real>
struct SurfelParameters {
  std::int64_t count = 0;
  int sh_degree = 0;                    ///< Of the arrays: (sh_degree + 1)^2 coefficients.
  int active_sh_degree = 0;             ///< Of the colours: <= sh_degree.
  const Real* position_m = nullptr;     ///< [count, 3], world frame.
  const Real* log_scale = nullptr;      ///< [count, 2], s = exp(log_scale) in metres.
  const Real* rotation = nullptr;       ///< [count, 4], quaternion w x y z of any length > 0.
  const Real* opacity_logit = nullptr;  ///< [count], o = 1 / (1 + exp(-logit)).
  const Real* sh = nullptr;             ///< [count, (sh_degree + 1)^2, 3].
};

/// Derivatives of the loss by SurfelParameters, of the same shapes. Overwritten, not added to;
/// surfels that the image does not show get zeros.
template <class Real>
struct SurfelGradients {
  Real* position_m = nullptr;
  Real* log_scale = nullptr;
  Real* rotation = nullptr;
  Real* opacity_logit = nullptr;
  Real* sh = nullptr;
  /// [count], may be null. Length of the loss's gradient by the projected centre, in units of
  /// half an image (the official statistic for densification, there in NDC); 0 where unseen.
  Real* screen = nullptr;
  /// [count], may be null. Largest weight alpha T of the surfel at any pixel of the image
  /// (exactly 0 if it has none): which surfels are seen, and which can be pruned. Written by
  /// forward().
  Real* max_weight = nullptr;
};

/// Images of one view, sums over the surfels k of a pixel, front to back, with the blending
/// weight w_k = alpha_k prod_{j<k} (1 - alpha_j); the background is black.
template <class Value>
struct TrainingImages {
  int width_px = 0, height_px = 0;
  Value* rgb = nullptr;         ///< [height, width, 3], sum w_k max(0, colour_k).
  Value* depth_m = nullptr;     ///< [height, width], sum w_k z_k; z of the ray-surfel hit.
  Value* alpha = nullptr;       ///< [height, width], sum w_k.
  Value* normal = nullptr;      ///< [height, width, 3], sum w_k n_k, world frame, n.ray < 0.
  Value* median_m = nullptr;    ///< [height, width], z of the surfel that brings T below 1/2;
                                ///< 0 without one. No gradient flows through it.
  Value* distortion = nullptr;  ///< [height, width], sum_{i,j} w_i w_j (m_i - m_j)^2 over i >
                                ///< j with m = far/(far - near) (1 - near/z), near 0.2 m, far
                                ///< 100 m (2DGS eq. 13). May be null.
};

}  // namespace segsim::reconstruction
