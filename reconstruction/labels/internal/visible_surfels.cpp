#include "reconstruction/labels/internal/visible_surfels.h"

namespace segsim::reconstruction::internal {
namespace {

/// A copy on the host.
Tensor host_copy(const std::int32_t* values, std::int64_t count, const at::Device& device) {
  // from_blob does not write to its data.
  return torch::from_blob(const_cast<void*>(static_cast<const void*>(values)), {count},
                          torch::TensorOptions().dtype(torch::kInt32).device(device))
      .to(torch::kCPU, torch::kInt64, /*non_blocking=*/false, /*copy=*/true);
}

}  // namespace

std::vector<std::int64_t> first_surfels(const PixelWeights& weights,
                                        const at::Device& device) {
  const Tensor start = host_copy(weights.row_start, weights.pixels + 1, device);
  const Tensor surfel = host_copy(weights.surfel, weights.entries, device);
  const auto* begin = start.data_ptr<std::int64_t>();
  std::vector<std::int64_t> first;
  for (std::int64_t p = 0; p < weights.pixels; ++p) {
    first.push_back(begin[p] == begin[p + 1] ? -1 : surfel.data_ptr<std::int64_t>()[begin[p]]);
  }
  return first;
}

}  // namespace segsim::reconstruction::internal
