#include "renderer/cuda/device_images.h"

#include <cstring>

#include "core/check.h"
#include "renderer/scene/depth_normal.h"

namespace segsim::renderer::cuda {

using core::Channels;
using core::has;

namespace {

/// Images lie this far apart in page-locked memory, at least.
constexpr std::size_t kAlignment = 256;

std::size_t aligned(std::size_t bytes) {
  return (bytes + kAlignment - 1) / kAlignment * kAlignment;
}

}  // namespace

ImageView DeviceImages::set_shape(const BatchShape& shape) {
  shape_ = shape;
  const std::size_t pixels = static_cast<std::size_t>(shape.width_px) *
                             static_cast<std::size_t>(shape.height_px) *
                             static_cast<std::size_t>(shape.cameras);
  const auto image = [&](Channels channel, auto& array, std::size_t elements) {
    const bool wanted = channel == Channels::kNone || has(shape.channels, channel);
    if (wanted) array.reserve(pixels * elements);
    return wanted ? array.data() : nullptr;
  };
  view_ = {.rgb = image(Channels::kRgb, rgb_, 3),
           .depth_m = image(Channels::kDepth, depth_m_, 1),
           .normal = image(Channels::kNormal, normal_, 3),
           .alpha = image(Channels::kNone, alpha_, 1),
           .semantic = image(Channels::kLabels, semantic_, 1),
           .instance = image(Channels::kLabels, instance_, 1),
           .confidence = image(Channels::kLabels, confidence_, 1),
           .instance_confidence = image(Channels::kLabels, instance_confidence_, 1),
           .semantic_feature = image(Channels::kFeatures, semantic_feature_, 16),
           .instance_feature = image(Channels::kFeatures, instance_feature_, 32)};
  return view_;
}

core::DeviceFrames DeviceImages::frames(cudaStream_t stream) const {
  int device = 0;
  throw_on_error(cudaGetDevice(&device), "cudaGetDevice");
  return {shape_.cameras,
          shape_.width_px,
          shape_.height_px,
          view_.rgb,
          view_.depth_m,
          view_.normal,
          view_.alpha,
          view_.semantic,
          view_.instance,
          view_.confidence,
          view_.instance_confidence,
          view_.semantic_feature,
          view_.instance_feature,
          device,
          stream};
}

void DeviceImages::read_back(int index, Channels channels, cudaStream_t stream,
                             core::Frame& frame) {
  const bool depth_normals = has(channels, Channels::kDepthNormal);
  transfers_.clear();
  staged_bytes_ = 0;
  const auto copy = [&](bool wanted, const auto* device, int channels_a_pixel, auto& image) {
    image.resize(wanted ? shape_.width_px : 0, wanted ? shape_.height_px : 0);
    if (!wanted) return;
    SEGSIM_CHECK(device != nullptr, "an image that was not rendered");
    const std::size_t bytes = image.size() * sizeof(*image.data());
    const std::size_t elements = image.size() * static_cast<std::size_t>(channels_a_pixel);
    transfers_.push_back(
        {device + static_cast<std::size_t>(index) * elements, image.data(), bytes});
    staged_bytes_ += aligned(bytes);
  };
  const bool labels = has(channels, Channels::kLabels);
  const bool features = has(channels, Channels::kFeatures);
  copy(has(channels, Channels::kRgb), view_.rgb, 3, frame.rgb);
  copy(has(channels, Channels::kDepth) || depth_normals, view_.depth_m, 1, frame.depth_m);
  copy(has(channels, Channels::kNormal), view_.normal, 3, frame.normal);
  copy(true, view_.alpha, 1, frame.alpha);
  copy(labels, view_.semantic, 1, frame.semantic);
  copy(labels, view_.instance, 1, frame.instance);
  copy(labels, view_.confidence, 1, frame.confidence);
  copy(labels, view_.instance_confidence, 1, frame.instance_confidence);
  copy(features, view_.semantic_feature, 16, frame.semantic_feature);
  copy(features, view_.instance_feature, 32, frame.instance_feature);
  run_transfers(stream);
  frame.depth_normal.resize(0, 0);
  if (depth_normals) {
    frame.depth_normal =
        renderer::depth_normals(frame.depth_m, frame.intrinsics, frame.T_world_camera);
    if (!has(channels, Channels::kDepth)) frame.depth_m.resize(0, 0);
  }
}

/// All are under way before the first is waited for.
void DeviceImages::run_transfers(cudaStream_t stream) {
  staging_.reserve(staged_bytes_);
  std::size_t at = 0;
  for (const Transfer& t : transfers_) {
    throw_on_error(
        cudaMemcpyAsync(staging_.data() + at, t.from, t.bytes, cudaMemcpyDeviceToHost, stream),
        "cudaMemcpyAsync");
    at += aligned(t.bytes);
  }
  throw_on_error(cudaStreamSynchronize(stream), "read-back");
  at = 0;
  for (const Transfer& t : transfers_) {
    std::memcpy(t.to, staging_.data() + at, t.bytes);
    at += aligned(t.bytes);
  }
}

void DeviceImages::poison(cudaStream_t stream) {
  const auto fill = [stream](const auto& image) {
    if (image.size() == 0) return;
    throw_on_error(cudaMemsetAsync(image.data(), 0xA5, image.bytes(), stream),
                   "cudaMemsetAsync");
  };
  fill(rgb_), fill(depth_m_), fill(normal_), fill(alpha_), fill(confidence_);
  fill(instance_confidence_), fill(semantic_feature_), fill(instance_feature_);
  fill(semantic_), fill(instance_);
  throw_on_error(cudaStreamSynchronize(stream), "cudaMemsetAsync");
}

}  // namespace segsim::renderer::cuda
