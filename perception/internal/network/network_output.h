#pragma once

#include <variant>

#include "perception/internal/network/network.h"

namespace segsim::perception {

/// What a network without anchors says about each cell of a map.
struct HeatMaps {
  torch::Tensor classes;  ///< Logits, high at centres of objects, [batch, classes, h, w].
  /// Distances from the cell's first pixel to the left, top, right and bottom side of the box,
  /// in pixels of the input, [batch, 4, h, w].
  torch::Tensor sides_px;
};

/// Of any of the networks. Inference and training branch on this, not on the network.
using NetworkOutput = std::variant<RawOutput, HeatMaps>;

/// In single precision, whatever the network ran in.
[[nodiscard]] inline NetworkOutput to_float32(const NetworkOutput& output) {
  return std::visit(
      [](auto copy) -> NetworkOutput {
        auto& [first, second] = copy;
        first = first.to(torch::kFloat32);
        second = second.to(torch::kFloat32);
        return copy;
      },
      output);
}

}  // namespace segsim::perception
