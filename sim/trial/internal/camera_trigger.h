#pragma once

/// @file
/// When the camera of a trial takes its images, and which of them a fault takes away.

#include <cstdint>
#include <vector>

#include "sim/time/clock.h"
#include "sim/trial/trial_faults.h"

namespace segsim::sim::internal {

class CameraTrigger {
 public:
  /// @param rate  With a period.  @param seed  Of the episode: what shakes the times.
  CameraTrigger(const SensorRate& rate, std::uint64_t seed, std::vector<FrameDropFault> drops);

  /// When the next image is due.
  [[nodiscard]] core::TimeNs next_ns() const { return rate_.time_of(next_, seed_); }
  /// Goes on to the image after that.
  /// @return  False if a fault takes the image that was due: it never leaves the camera.
  [[nodiscard]] bool release();
  /// Images that faults took.
  [[nodiscard]] int dropped() const { return dropped_; }

 private:
  SensorRate rate_;
  std::uint64_t seed_;
  std::vector<FrameDropFault> drops_;  ///< Their counts are what is left.
  std::uint64_t next_ = 0;
  int dropped_ = 0;
};

}  // namespace segsim::sim::internal
