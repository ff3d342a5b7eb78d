#pragma once

/// @file
/// The images of a batch in device memory, and their way to the host.

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/device_frames.h"
#include "core/render.h"
#include "renderer/cuda/device_data.h"
#include "renderer/cuda/device_memory.h"

namespace segsim::renderer::cuda {

/// What a batch is drawn with; a new one needs new buffers and a new graph.
struct BatchShape {
  int width_px = 0, height_px = 0, cameras = 0;
  core::Channels channels = core::Channels::kNone;
  bool operator==(const BatchShape&) const = default;
};

class DeviceImages {
 public:
  /// Makes room. Images of other channels become null.
  ImageView set_shape(const BatchShape& shape);

  [[nodiscard]] core::DeviceFrames frames(cudaStream_t stream) const;

  /// Copies image `index` to the host through page-locked memory and waits for it.
  /// `frame` has its camera already: depth normals need it.
  void read_back(int index, core::Channels channels, cudaStream_t stream, core::Frame& frame);

  /// Fills all images with bytes of 0xA5 and waits for it.
  void poison(cudaStream_t stream);

 private:
  struct Transfer {
    const void* from;
    void* to;
    std::size_t bytes;
  };

  void run_transfers(cudaStream_t stream);

  DeviceArray<std::uint8_t> rgb_;
  DeviceArray<float> depth_m_, normal_, alpha_, confidence_, instance_confidence_;
  DeviceArray<float> semantic_feature_, instance_feature_;
  DeviceArray<std::uint16_t> semantic_, instance_;
  BatchShape shape_;
  ImageView view_{};
  PinnedArray<std::byte> staging_;
  std::vector<Transfer> transfers_;
  std::size_t staged_bytes_ = 0;
};

}  // namespace segsim::renderer::cuda
