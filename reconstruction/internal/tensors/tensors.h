#pragma once

/// @file
/// The part of libtorch that the heads use: tensors and autograd, without torch::nn, whose
/// headers take twice as long to compile. Works with libtorch 1.13 and 2.x.

#include <torch/csrc/autograd/custom_function.h>
#include <torch/csrc/autograd/variable.h>
#include <torch/types.h>

namespace segsim::reconstruction::internal {

using at::Tensor;

/// A copy of host values on the device.
template <class Value>
[[nodiscard]] Tensor device_tensor(const std::vector<Value>& values, at::ScalarType type,
                                   const at::Device& device) {
  const auto size = static_cast<std::int64_t>(values.size());
  Tensor host = torch::empty({size}, torch::TensorOptions().dtype(type));
  if (size > 0) {
    std::copy(values.begin(), values.end(), static_cast<Value*>(host.data_ptr()));
  }
  return host.to(device);
}

}  // namespace segsim::reconstruction::internal
