#pragma once

/// @file
/// Trials of one episode begin alike: until a detection sends one of them another way, robots
/// of all arms stand at the same poses, to the last bit, and see the same images. Drawing them
/// once is what makes several trainings of a detector affordable.

#include <array>
#include <cstddef>
#include <cstdint>
#include <unordered_map>

#include "core/render.h"

namespace segsim::experiments::trials {

/// Draws by another renderer, and remembers: what was drawn from the very same pose is copied.
/// The images are those of the other renderer, and so is `stats`, which tells what drawing
/// cost when it was done.
class SharedViews final : public core::Renderer {
 public:
  /// Two minutes of images at 256x192, four a second: nearly all that come again.
  static constexpr std::size_t kCapacity_bytes = std::size_t{512} << 20U;

  /// @param inner  Must outlive this object, and draw the same scene all the time.
  /// @param capacity_bytes  Once images fill it, further ones are drawn and not remembered:
  ///     those at the beginning of an episode are the ones that come again.
  explicit SharedViews(core::Renderer& inner, std::size_t capacity_bytes = kCapacity_bytes)
      : inner_(inner), capacity_bytes_(capacity_bytes) {}

  using core::Renderer::render;
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              core::Channels channels, core::Frame& frame) override;

 private:
  /// Bits of rotation, translation, intrinsics and channels: equal inputs, equal images.
  using Key = std::array<std::uint64_t, 13>;
  struct Hash {
    std::size_t operator()(const Key& key) const;
  };

  core::Renderer& inner_;
  std::size_t capacity_bytes_;
  std::size_t used_bytes_ = 0;
  std::unordered_map<Key, core::Frame, Hash> frames_;
};

}  // namespace segsim::experiments::trials
