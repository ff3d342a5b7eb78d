// Where training runs.

#include <ATen/Context.h>
#include "core/error.h"
#include "reconstruction/training/geometry_training.h"

#ifdef SEGSIM_WITH_CUDA_TRAINING
#include "reconstruction/rasterizer/cuda/cuda_rasterizer.h"
#endif

namespace segsim::reconstruction {
namespace {

/// Empty, or why the GPU cannot train.
std::string gpu_fault() {
#ifdef SEGSIM_WITH_CUDA_TRAINING
  return at::hasCUDA() ? "" : "libtorch without CUDA or no GPU";
#else
  return "a program without CUDA (preset cuda)";
#endif
}

std::unique_ptr<DifferentiableRasterizer<float>> make_on_processors(
    [[maybe_unused]] const GeometryDevice& device) {
#ifdef SEGSIM_WITHOUT_CPU_RENDERER
  throw core::InputError::expected("backend", "cuda: this program has no other", "cpu");
#else
  return make_cpu_rasterizer<float>({.threads = device.threads});
#endif
}

}  // namespace

bool trains_on_gpu(const GeometryDevice& device) {
  if (device.backend == renderer::Backend::kCpu) return false;
  const std::string fault = gpu_fault();
  if (!fault.empty() && device.backend == renderer::Backend::kCuda) {
    throw core::InputError::expected("--backend cuda", "a program and libtorch with CUDA",
                                     fault);
  }
  if (fault.empty() && device.deterministic) {
    at::globalContext().setDeterministicAlgorithms(true, /*warn_only=*/true);
  }
  return fault.empty();
}

std::unique_ptr<DifferentiableRasterizer<float>> make_training_rasterizer(
    const GeometryDevice& device) {
  if (!trains_on_gpu(device)) return make_on_processors(device);
#ifdef SEGSIM_WITH_CUDA_TRAINING
  return make_cuda_rasterizer({.stream = nullptr, .deterministic = device.deterministic});
#else
  return nullptr;
#endif
}

}  // namespace segsim::reconstruction
