#pragma once

/// @file
/// The differentiable rasterizer over arrays of Python: those of NumPy, PyTorch and whatever
/// else exports DLPack, read and written in place. Without PyTorch's headers and libraries, so
/// that one build serves every version of it.

#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "python/native/camera_arguments.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"

namespace segsim::python {

/// One view at a time: backward() differentiates the last forward(). Calls of several threads
/// wait for one another; other threads of Python run meanwhile.
/// @tparam Device  nanobind::device::cpu or cuda: where all arrays are.
template <class Real, class Device>
class ViewRasterizer {
 public:
  using Input = nanobind::ndarray<const Real, nanobind::c_contig, Device>;
  using Output = nanobind::ndarray<Real, nanobind::c_contig, Device>;
  /// position_m, log_scale, rotation, opacity_logit, sh: of SurfelParameters.
  using Surfels = std::array<Input, 5>;
  using Gradients = std::array<Output, 5>;
  /// rgb, depth_m, alpha, normal, median_m, distortion: of TrainingImages.
  using Images = std::array<std::optional<Output>, 6>;
  /// Derivatives by rgb, depth_m, alpha, normal, distortion; none counts as zero.
  using Loss = std::array<std::optional<Input>, 5>;

  explicit ViewRasterizer(
      std::unique_ptr<reconstruction::DifferentiableRasterizer<Real>> rasterizer);

  /// Draws view `view` of `cameras`.
  /// @throws core::ContractViolation for an array of another size.
  void forward(const Surfels& surfels, int active_sh_degree, const Views& cameras,
               std::size_t view, const Images& images, const Output& max_weight);

  /// @param surfels, active_sh_degree  As forward() had them.
  void backward(const Surfels& surfels, int active_sh_degree, const Loss& loss,
                const Gradients& gradients, const std::optional<Output>& screen);

 private:
  std::mutex mutex_;  // Guards what follows.
  std::unique_ptr<reconstruction::DifferentiableRasterizer<Real>> rasterizer_;
  int width_px_ = 0, height_px_ = 0;
};

/// Cameras, and CpuRasterizer32, CpuRasterizer64 and, where the package was built with CUDA,
/// CudaRasterizer.
void bind_rasterizers(nanobind::module_& module);

}  // namespace segsim::python
