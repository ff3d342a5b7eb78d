#pragma once

#include <functional>
#include <string>

#include "perception/checkpoint/weights_file.h"
#include "perception/internal/network/network.h"

namespace segsim::perception {

/// Forward pass of one network in inference mode: [batch, 3, h, w] -> logits of all anchors.
using InferenceNetwork = std::function<RawOutput(const torch::Tensor&)>;

/// The network that the weights are for, with their tensors, on `device`.
/// @throws core::InputError that starts with `place` if they do not fit.
[[nodiscard]] InferenceNetwork make_inference_network(
    const DetectorWeights& weights, const std::string& place,
    const torch::Device& device = torch::kCPU);

}  // namespace segsim::perception
