#include "perception/detector/internal/frame_stream.h"

#ifdef SEGSIM_TORCH_CUDA
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>
#endif

namespace segsim::perception {

#ifdef SEGSIM_TORCH_CUDA

struct FrameStreamScope::Guard {
  explicit Guard(const core::DeviceFrames& frames)
      : stream(c10::cuda::getStreamFromExternal(
            frames.stream, static_cast<c10::DeviceIndex>(frames.device))) {}
  c10::cuda::CUDAStreamGuard stream;
};

FrameStreamScope::FrameStreamScope(const core::DeviceFrames& frames) {
  if (frames.device != core::kHostDevice) guard_ = std::make_unique<Guard>(frames);
}

#else

struct FrameStreamScope::Guard {};

FrameStreamScope::FrameStreamScope(const core::DeviceFrames& /*frames*/) {}

#endif

FrameStreamScope::~FrameStreamScope() = default;

}  // namespace segsim::perception
