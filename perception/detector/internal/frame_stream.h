#pragma once

#include <memory>

#include "core/device_frames.h"

namespace segsim::perception {

/// While it lives, libtorch works in the stream that writes the images: it reads them after
/// the renderer has written them, and the renderer's next batch is drawn after libtorch has
/// read them, without a wait in between. Does nothing for images in the host's memory, and
/// where libtorch has no CUDA.
class FrameStreamScope {
 public:
  explicit FrameStreamScope(const core::DeviceFrames& frames);
  ~FrameStreamScope();
  FrameStreamScope(const FrameStreamScope&) = delete;
  FrameStreamScope& operator=(const FrameStreamScope&) = delete;

 private:
  struct Guard;
  std::unique_ptr<Guard> guard_;
};

}  // namespace segsim::perception
