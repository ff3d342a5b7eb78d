#pragma once

/// @file
/// Surfels -> images -> derivatives by the surfels. Forward is the inference renderer's maths
/// (surfel_geometry.h: exact conic, low pass, alpha below 1/255 skipped, stop below T = 1e-4);
/// backward is its exact derivative except where alpha is clamped at 0.99, through which no
/// gradient flows (as in 2DGS and gsplat).

#include <cstdint>
#include <memory>
#include <span>

#include "core/camera.h"
#include "core/error.h"
#include "core/frames.h"
#include "reconstruction/rasterizer/surfel_parameters.h"

namespace segsim::reconstruction {

/// Sparse matrix of blending weights in compressed rows: row p lists the surfels of listed
/// pixel p, front to back.
struct PixelWeights {
  std::int64_t pixels = 0, entries = 0;
  const std::int32_t* row_start = nullptr;  ///< [pixels + 1].
  const std::int32_t* surfel = nullptr;     ///< [entries].
  const float* weight = nullptr;            ///< [entries], w_k.
};

/// One view at a time: forward() keeps what backward() and weights() need until the next
/// forward(). Not for use by two threads at once.
template <class Real>
class DifferentiableRasterizer {
 public:
  virtual ~DifferentiableRasterizer() = default;

  /// Draws the view. `images` must have the size of the camera.
  /// @param max_weight  [count], may be null: SurfelGradients::max_weight.
  /// @throws core::ContractViolation for a null array or a size that differs.
  virtual void forward(const SurfelParameters<Real>& surfels,
                       const core::CameraIntrinsics& camera,
                       const core::CameraPose& T_world_camera,
                       const TrainingImages<Real>& images, Real* max_weight) = 0;

  /// @param loss  Derivatives of the loss by the images of the last forward(); null members
  ///     count as zero, median_m is ignored.
  virtual void backward(const SurfelParameters<Real>& surfels,
                        const TrainingImages<const Real>& loss,
                        const SurfelGradients<Real>& gradients) = 0;

  /// Adds a loss of weights() to those that the next backward() differentiates.
  /// @param pixels  Those that weights() was asked for, with max_per_pixel = 0.
  /// @param weights  What it gave, in host memory. Like the derivatives, copied.
  /// @param by_weight  [weights.entries], derivatives of the loss.
  /// @throws core::InputError on a GPU.
  virtual void add_weight_loss(std::span<const std::int32_t> pixels,
                               const PixelWeights& weights, const float* by_weight);

  /// Weights of the last forward() at pixels y * width + x, valid until the next call of any
  /// function.
  /// @param max_per_pixel  The heaviest of a pixel (ties by lower index); 0 = all.
  [[nodiscard]] virtual PixelWeights weights(const std::int32_t* pixels, std::int64_t count,
                                             int max_per_pixel) = 0;
};

struct DifferentiableRasterizerOptions {
  int threads = 0;  ///< 0 = all processors. Gradients do not depend on it.
};

/// Real is float or double.
template <class Real>
[[nodiscard]] std::unique_ptr<DifferentiableRasterizer<Real>> make_cpu_rasterizer(
    const DifferentiableRasterizerOptions& options = {});

template <class Real>
void DifferentiableRasterizer<Real>::add_weight_loss(std::span<const std::int32_t>,
                                                     const PixelWeights&, const float*) {
  throw core::InputError::expected("losses of blending weights (--labels joint)",
                                   "training on the CPU (--backend cpu)", "a GPU");
}

}  // namespace segsim::reconstruction
