#pragma once

/// @file
/// Derivatives of libtorch functions against central differences, in double precision.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "core/random.h"
#include "reconstruction/internal/tensors/tensors.h"

namespace segsim::reconstruction::testing {

inline at::Tensor random_tensor(const std::vector<std::int64_t>& shape, std::uint64_t seed,
                                double lo = -1.0, double hi = 1.0) {
  core::RandomStream random(seed, "random_tensor");
  at::Tensor values = torch::empty(shape, torch::TensorOptions().dtype(torch::kFloat64));
  for (std::int64_t i = 0; i < values.numel(); ++i) {
    values.data_ptr<double>()[i] = random.uniform(lo, hi);
  }
  return values;
}

inline at::Tensor tensor_of(const std::vector<double>& values,
                            const std::vector<std::int64_t>& shape) {
  return internal::device_tensor(values, torch::kFloat64, torch::kCPU).view(shape);
}

/// Checks d f / d inputs[i] for every element of every input. f gives a scalar.
inline void expect_derivatives(
    const std::function<at::Tensor(const std::vector<at::Tensor>&)>& f,
    const std::vector<at::Tensor>& at, double tolerance = 1e-6) {
  std::vector<at::Tensor> leaves;
  for (const at::Tensor& t : at) leaves.push_back(t.clone().requires_grad_(true));
  f(leaves).backward();
  const at::NoGradGuard no_grad;
  constexpr double kStep = 1e-5;
  for (std::size_t i = 0; i < at.size(); ++i) {
    ASSERT_TRUE(leaves[i].grad().defined()) << "input " << i;
    const at::Tensor gradient = leaves[i].grad().contiguous();
    double largest = 0.0;
    for (std::int64_t k = 0; k < at[i].numel(); ++k) {
      std::vector<at::Tensor> moved;
      for (const at::Tensor& t : at) moved.push_back(t.clone());
      double& value = moved[i].data_ptr<double>()[k];
      const double before = value;
      value = before + kStep;
      const double above = f(moved).item<double>();
      value = before - kStep;
      const double below = f(moved).item<double>();
      const double expected = (above - below) / (2.0 * kStep);
      EXPECT_NEAR(gradient.data_ptr<double>()[k], expected,
                  tolerance * (1.0 + std::abs(expected)))
          << "input " << i << ", element " << k;
      largest = std::max(largest, std::abs(expected));
    }
    EXPECT_GT(largest, 1e-4) << "input " << i << " does not matter: nothing was tested";
  }
}

}  // namespace segsim::reconstruction::testing
