#pragma once

/// @file
/// Depth from colour, where a robot has no depth camera (VLFM's Spot variant asks ZoeDepth).

#include "core/image.h"
#include "core/stages.h"

namespace segsim::nav {

class DepthInference {
 public:
  virtual ~DepthInference() = default;
  /// Of the observation's colours, as large as these; along the optical axis.
  virtual void infer(const core::Observation& observation, core::Image<float>& depth_m) = 0;
};

}  // namespace segsim::nav
