#include "sim/trial/internal/camera_trigger.h"

#include <utility>

namespace segsim::sim::internal {

CameraTrigger::CameraTrigger(const SensorRate& rate, std::uint64_t seed,
                             std::vector<FrameDropFault> drops)
    : rate_(rate), seed_(seed), drops_(std::move(drops)) {}

bool CameraTrigger::release() {
  const core::TimeNs due_ns = next_ns();
  ++next_;
  bool taken = false;
  // Faults that overlap each count the image as one of theirs.
  for (FrameDropFault& fault : drops_) {
    if (due_ns < fault.from_ns || fault.count == 0) continue;
    --fault.count;
    taken = true;
  }
  dropped_ += taken ? 1 : 0;
  return !taken;
}

}  // namespace segsim::sim::internal
