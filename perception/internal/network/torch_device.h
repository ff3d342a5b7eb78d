#pragma once

#include <ATen/Context.h>
#include <torch/cuda.h>
#include <torch/types.h>

#include <string>

#include "core/error.h"
#include "perception/data/compute_device.h"

namespace segsim::perception {

/// On CUDA float32 means float32 from here on (libtorch would let convolutions round their
/// inputs to ten bits, TF32), and equal inputs give equal bits: sums have a fixed order.
/// @throws core::InputError that starts with `place` for CUDA where there is none.
[[nodiscard]] inline torch::Device torch_device(ComputeDevice device,
                                                const std::string& place) {
  if (device == ComputeDevice::kCpu) return torch::kCPU;
  if (!torch::cuda::is_available()) {
    throw core::InputError::expected(place, "cpu",
                                     "cuda, which this libtorch or machine does not have");
  }
  at::globalContext().setAllowTF32CuDNN(false);
  at::globalContext().setDeterministicAlgorithms(true, /*warn_only=*/true);
  return torch::kCUDA;
}

}  // namespace segsim::perception
