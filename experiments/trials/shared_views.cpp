#include "experiments/trials/shared_views.h"

#include <bit>
#include <string_view>

#include "core/random.h"

namespace segsim::experiments::trials {
namespace {

template <class Pixel>
std::size_t bytes_of(const core::Image<Pixel>& image) {
  return image.size() * sizeof(Pixel);
}

std::size_t bytes_of(const core::Frame& frame) {
  return bytes_of(frame.rgb) + bytes_of(frame.depth_m) + bytes_of(frame.normal) +
         bytes_of(frame.alpha) + bytes_of(frame.semantic) + bytes_of(frame.instance) +
         bytes_of(frame.confidence) + bytes_of(frame.instance_confidence) +
         bytes_of(frame.depth_normal) + bytes_of(frame.semantic_feature) +
         bytes_of(frame.instance_feature);
}

}  // namespace

std::size_t SharedViews::Hash::operator()(const Key& key) const {
  return core::hash64(
      std::string_view(reinterpret_cast<const char*>(key.data()), key.size() * sizeof key[0]));
}

void SharedViews::render(const core::CameraPose& T_world_camera,
                         const core::CameraIntrinsics& intrinsics, core::Channels channels,
                         core::Frame& frame) {
  const glm::dquat& R = T_world_camera.rotation();
  const glm::dvec3& p_m = T_world_camera.translation_m();
  const auto bits = [](double value) { return std::bit_cast<std::uint64_t>(value); };
  const Key key{bits(R.w),
                bits(R.x),
                bits(R.y),
                bits(R.z),
                bits(p_m.x),
                bits(p_m.y),
                bits(p_m.z),
                bits(intrinsics.fx_px),
                bits(intrinsics.fy_px),
                bits(intrinsics.cx_px),
                bits(intrinsics.cy_px),
                static_cast<std::uint64_t>(intrinsics.width_px) << 32U |
                    static_cast<std::uint64_t>(intrinsics.height_px),
                static_cast<std::uint64_t>(channels)};
  const auto known = frames_.find(key);
  if (known != frames_.end()) {
    frame = known->second;
    return;
  }
  inner_.render(T_world_camera, intrinsics, channels, frame);
  const std::size_t size_bytes = bytes_of(frame);
  if (used_bytes_ + size_bytes > capacity_bytes_) return;
  used_bytes_ += size_bytes;
  frames_.emplace(key, frame);
}

}  // namespace segsim::experiments::trials
