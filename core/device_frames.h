#pragma once

/// @file
/// Rendered images where the renderer made them: in a GPU's memory. Perception reads them
/// there (perception/detector/device_frame_tensors.h), without a copy.

#include <cstdint>

struct CUstream_st;

namespace segsim::core {

/// DeviceFrames::device of images in the host's memory.
inline constexpr int kHostDevice = -1;

/// A batch of images without padding: image i of a channel starts at i * height * width
/// pixels. Null: not asked for. Values are those of core::Frame. The memory belongs to the
/// renderer, which says how long it stays.
struct DeviceFrames {
  int count = 0, width_px = 0, height_px = 0;
  const std::uint8_t* rgb = nullptr;  ///< [count, height, width, 3]
  const float* depth_m = nullptr;     ///< [count, height, width]
  const float* normal = nullptr;      ///< [count, height, width, 3]
  const float* alpha = nullptr;
  const std::uint16_t *semantic = nullptr, *instance = nullptr;
  const float *confidence = nullptr, *instance_confidence = nullptr;
  const float* semantic_feature = nullptr;  ///< [count, height, width, 16]
  const float* instance_feature = nullptr;  ///< [count, height, width, 32]
  int device = kHostDevice;                 ///< CUDA's number of the GPU.
  CUstream_st* stream = nullptr;            ///< That writes them (a cudaStream_t).
};

}  // namespace segsim::core
