#pragma once

#include <functional>
#include <string>

#include "perception/checkpoint/weights_file.h"
#include "perception/internal/network/network_output.h"

namespace segsim::perception {

/// Forward pass of one network in inference mode, of [batch, 3, h, w].
using InferenceNetwork = std::function<NetworkOutput(const torch::Tensor&)>;

/// The network that the weights are for, with their tensors, on `device`.
/// @throws core::InputError that starts with `place` if they do not fit.
[[nodiscard]] InferenceNetwork make_inference_network(
    const DetectorWeights& weights, const std::string& place,
    const torch::Device& device = torch::kCPU);

}  // namespace segsim::perception
