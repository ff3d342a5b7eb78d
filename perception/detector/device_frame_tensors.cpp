#include "perception/detector/device_frame_tensors.h"

#include <torch/cuda.h>
#include <torch/types.h>

#include <string>
#include <vector>

#include "core/check.h"
#include "core/error.h"
#include "core/render.h"

namespace segsim::perception {
namespace {

struct Source {
  const void* pixels;
  torch::ScalarType type;
  int channels;  ///< 0: the image has no axis for them.
};

Source source_of(const core::DeviceFrames& f, DeviceImage image) {
  switch (image) {
    case DeviceImage::kRgb:
      return {f.rgb, torch::kUInt8, 3};
    case DeviceImage::kDepth:
      return {f.depth_m, torch::kFloat32, 0};
    case DeviceImage::kNormal:
      return {f.normal, torch::kFloat32, 3};
    case DeviceImage::kAlpha:
      return {f.alpha, torch::kFloat32, 0};
    case DeviceImage::kSemantic:
      return {f.semantic, torch::kInt16, 0};
    case DeviceImage::kInstance:
      return {f.instance, torch::kInt16, 0};
    case DeviceImage::kConfidence:
      return {f.confidence, torch::kFloat32, 0};
    case DeviceImage::kInstanceConfidence:
      return {f.instance_confidence, torch::kFloat32, 0};
    case DeviceImage::kSemanticFeature:
      return {f.semantic_feature, torch::kFloat32, core::kSemanticFeatureSize};
    case DeviceImage::kInstanceFeature:
      return {f.instance_feature, torch::kFloat32, core::kInstanceFeatureSize};
  }
  return {nullptr, torch::kFloat32, 0};
}

torch::Device device_of(const core::DeviceFrames& frames) {
  if (frames.device == core::kHostDevice) return torch::kCPU;
  const auto gpus = static_cast<long long>(torch::cuda::device_count());
  if (frames.device < 0 || frames.device >= gpus) {
    throw core::InputError(
        "libtorch: expected CUDA with GPU " + std::to_string(frames.device) +
        ", where the images are, found " +
        (gpus == 0 ? std::string("a libtorch without CUDA") : std::to_string(gpus) + " GPUs"));
  }
  return {torch::kCUDA, static_cast<torch::DeviceIndex>(frames.device)};
}

}  // namespace

at::Tensor image_tensor(const core::DeviceFrames& frames, DeviceImage image) {
  const Source source = source_of(frames, image);
  SEGSIM_CHECK(source.pixels != nullptr, "an image that was not rendered");
  std::vector<std::int64_t> shape{frames.count, frames.height_px, frames.width_px};
  if (source.channels > 0) shape.push_back(source.channels);
  // from_blob() wants memory that it may change; nothing of ours does.
  return torch::from_blob(const_cast<void*>(source.pixels), shape,
                          torch::TensorOptions().dtype(source.type).device(device_of(frames)));
}

}  // namespace segsim::perception
