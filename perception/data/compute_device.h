#pragma once

namespace segsim::perception {

/// Where a network runs.
enum class ComputeDevice { kCpu, kCuda };

}  // namespace segsim::perception
