#pragma once

/// @file
/// Images of a GPU renderer as libtorch tensors over the same memory, so that a network reads
/// them without a copy. Compiles against libtorch 1.13 and 2.x, with or without CUDA.
///
///     const core::DeviceFrames& frames = renderer.render_batch(poses, camera, channels);
///     renderer.wait();
///     const at::Tensor rgb = image_tensor(frames, DeviceImage::kRgb);  // uint8, NHWC
///
/// The tensor is a view: it is valid as long as the renderer keeps the images, and work on it
/// must be complete before the renderer's next frame (libtorch has a stream of its own).

#include "core/device_frames.h"

namespace at {
class Tensor;
}

namespace segsim::perception {

/// An image of core::DeviceFrames, as a tensor of
///
///     rgb                                  uint8   [count, height, width, 3]
///     normal                               float   [count, height, width, 3]
///     depth [m], alpha, confidences        float   [count, height, width]
///     semantic, instance                   int16   [count, height, width]
///     features                             float   [count, height, width, 16 or 32]
///
/// libtorch 1.13 has no unsigned 16-bit integers: ids above 32767 appear as id - 65536.
enum class DeviceImage {
  kRgb,
  kDepth,
  kNormal,
  kAlpha,
  kSemantic,
  kInstance,
  kConfidence,
  kInstanceConfidence,
  kSemanticFeature,
  kInstanceFeature,
};

/// @throws core::ContractViolation if the image was not rendered; core::InputError if it lies
///     on a GPU and this libtorch has no CUDA, or not that GPU.
[[nodiscard]] at::Tensor image_tensor(const core::DeviceFrames& frames, DeviceImage image);

}  // namespace segsim::perception
