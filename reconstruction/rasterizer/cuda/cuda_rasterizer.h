#pragma once

/// @file
/// The differentiable rasterizer for NVIDIA GPUs of compute capability 8.0 and above. All
/// arrays of parameters, images, gradients and pixels are in the memory of the present device,
/// and so is what weights() returns.
///
///     forward   parameters -> surfels on screen -> tiles' lists      (project.cu)
///               -> sort, blend front to back; of each list entry
///                  the pixels that it was blended into               (forward.cu)
///     backward  a warp walks a quarter of a tile front to back and
///               adds up each surfel's derivatives over its pixels    (backward.cu)
///               -> once per surfel, back to the parameters           (gradients.cu)
///
/// Work is put into a stream. forward() waits for the lists, not for the images, since lists
/// that are too long must be made anew; weights() waits because it returns a size.

#include <memory>

#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "renderer/cuda/gpu_error.h"

struct CUstream_st;

namespace segsim::reconstruction {

struct CudaRasterizerOptions {
  /// A cudaStream_t; null is the default stream, which libtorch uses unless told otherwise.
  CUstream_st* stream = nullptr;
  /// Gradients are summed in a fixed order, so that equal inputs give equal bits: slower, and
  /// 272 more bytes for each pair of a surfel and a tile. Images, max_weight and weights() are
  /// repeatable without it.
  bool deterministic = false;
};

/// @throws GpuError if there is no suitable device; later, if its memory is full.
[[nodiscard]] std::unique_ptr<DifferentiableRasterizer<float>> make_cuda_rasterizer(
    const CudaRasterizerOptions& options = {});

}  // namespace segsim::reconstruction
