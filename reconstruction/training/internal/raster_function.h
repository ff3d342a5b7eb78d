#pragma once

/// @file
/// The rasterizer as a function of libtorch's autograd. Tensors live where the rasterizer
/// reads: in host memory for the CPU's, on its device for CUDA's.

#include <memory>

#include "core/camera.h"
#include "core/frames.h"
#include "reconstruction/internal/tensors/tensors.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"

namespace segsim::reconstruction::internal {

/// Raw parameters (surfel_parameters.h), float32, contiguous.
struct SurfelTensors {
  Tensor position_m;     ///< [n, 3]
  Tensor log_scale;      ///< [n, 2]
  Tensor rotation;       ///< [n, 4]
  Tensor opacity_logit;  ///< [n]
  Tensor sh;             ///< [n, (degree + 1)^2, 3]
};

struct ViewTensors {
  Tensor rgb;         ///< [height, width, 3]
  Tensor depth_m;     ///< [height, width], sum of weight * depth.
  Tensor alpha;       ///< [height, width]
  Tensor normal;      ///< [height, width, 3], world frame.
  Tensor distortion;  ///< [height, width]; undefined unless asked for.
  Tensor median_m;    ///< [height, width], no gradient.
  Tensor max_weight;  ///< [n], no gradient.
  Tensor screen;      ///< [n]: after backward(), the screen gradient of each surfel.
};

/// One rasterizer with the state of its last view: a view must be differentiated before the
/// next one is drawn.
class RasterFunction {
 public:
  /// @param rasterizer  Float; not null.
  RasterFunction(std::unique_ptr<DifferentiableRasterizer<float>> rasterizer,
                 const at::Device& device);

  /// Draws a view; the images' graph leads to those of the tensors that require gradients.
  [[nodiscard]] ViewTensors draw(const SurfelTensors& surfels, int active_sh_degree,
                                 const core::CameraIntrinsics& camera,
                                 const core::CameraPose& T_world_camera, bool with_distortion);

  [[nodiscard]] DifferentiableRasterizer<float>& rasterizer() { return *rasterizer_; }
  [[nodiscard]] const at::Device& device() const { return device_; }

 private:
  std::unique_ptr<DifferentiableRasterizer<float>> rasterizer_;
  at::Device device_;
  std::int64_t views_ = 0;  ///< Drawn so far.

  friend struct RasterCall;
};

/// Pointers to the tensors. @throws core::ContractViolation for other shapes.
[[nodiscard]] SurfelParameters<float> parameters_of(const SurfelTensors& surfels,
                                                    int active_sh_degree);

}  // namespace segsim::reconstruction::internal
