#pragma once

/// @file
/// What goes wrong in a trial on purpose: a stage that takes longer for a while, images that
/// are lost.

#include <string>
#include <vector>

#include "core/stages.h"

namespace segsim::sim {

/// Jobs of a stage that begin in [from, until) take that much longer.
struct LatencyFault {
  std::string stage;  ///< Of the budget.
  core::TimeNs from_ns = 0, until_ns = 0;
  core::TimeNs added_ns = 0;
};

/// The first `count` images that are due at `from` or later never leave the camera.
struct FrameDropFault {
  core::TimeNs from_ns = 0;
  int count = 0;
};

struct TrialFaults {
  std::vector<LatencyFault> latencies;
  std::vector<FrameDropFault> frame_drops;

  /// Time on top for a job of that stage that begins now.
  [[nodiscard]] core::TimeNs added_ns(const std::string& stage, core::TimeNs now_ns) const {
    core::TimeNs sum_ns = 0;
    for (const LatencyFault& fault : latencies) {
      const bool holds = now_ns >= fault.from_ns && now_ns < fault.until_ns;
      if (holds && fault.stage == stage) sum_ns += fault.added_ns;
    }
    return sum_ns;
  }
};

}  // namespace segsim::sim
