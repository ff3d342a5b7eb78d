#pragma once

/// @file
/// What a renderer makes, and the seam that every renderer stands behind.

#include <array>
#include <cstdint>

#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"

namespace segsim::core {

/// Set of output images, as bits.
enum class Channels : std::uint32_t {
  kNone = 0,
  kRgb = 1U << 0U,
  kDepth = 1U << 1U,
  kNormal = 1U << 2U,
  kLabels = 1U << 3U,       ///< semantic, instance and their confidences
  kDepthNormal = 1U << 4U,  ///< Normal of the depth image, to compare with the surfels' own.
  kFeatures = 1U << 5U,     ///< Blended 16-D semantic and 32-D instance features.
  kRgbd = kRgb | kDepth,
  kAll = kRgb | kDepth | kNormal | kLabels,
};
[[nodiscard]] constexpr Channels operator|(Channels a, Channels b) {
  return static_cast<Channels>(static_cast<std::uint32_t>(a) | static_cast<std::uint32_t>(b));
}
[[nodiscard]] constexpr bool has(Channels set, Channels wanted) {
  return (static_cast<std::uint32_t>(set) & static_cast<std::uint32_t>(wanted)) ==
         static_cast<std::uint32_t>(wanted);
}

/// Work done for one frame.
struct RenderStats {
  std::uint64_t surfels_projected = 0;  ///< Surfels that reach the image.
  std::uint64_t pairs_binned = 0;       ///< (tile, surfel) pairs in the tile lists.
  std::uint64_t pairs_touched = 0;      ///< Pairs read before their tile saturated.
  std::uint64_t evaluations = 0;        ///< (pixel, surfel) intersections computed.
  std::uint64_t contributions = 0;      ///< Evaluations that changed their pixel.
  std::uint64_t feature_fetches = 0;    ///< Label or feature rows read for pixels.
  double render_ms = 0.0;               ///< Wall time.
};

inline constexpr int kSemanticFeatureSize = 16;  ///< Paper, "Implementation Details".
inline constexpr int kInstanceFeatureSize = 32;
using SemanticFeature = std::array<float, kSemanticFeatureSize>;
using InstanceFeature = std::array<float, kInstanceFeatureSize>;

/// One number for class and instance: unique in a scene.
[[nodiscard]] constexpr std::uint32_t panoptic_id(std::uint16_t semantic,
                                                  std::uint16_t instance) {
  return static_cast<std::uint32_t>(semantic) << 16U | instance;
}

/// One rendered view. Images that were not asked for are empty; alpha is always there.
struct Frame {
  CameraIntrinsics intrinsics;
  CameraPose T_world_camera;
  Image<Rgb8> rgb;          ///< sRGB over a black background.
  Image<float> depth_m;     ///< Of the surface, along +z; NaN where alpha < 0.5.
  Image<glm::vec3> normal;  ///< World frame, unit, towards the camera; 0 where alpha < 0.5.
  Image<float> alpha;       ///< Accumulated opacity, [0, 1].
  Image<std::uint16_t> semantic;  ///< Class id, 0 = void; also where alpha < 0.5.
  Image<std::uint16_t> instance;  ///< Instance id, 0 = none.
  Image<float> confidence;  ///< Share of the Top-K weight that voted for `semantic`, [0, 1].
  Image<float> instance_confidence;  ///< The same for `instance`.
  Image<glm::vec3> depth_normal;     ///< World frame, unit, towards the camera; 0 = unknown.
  Image<SemanticFeature> semantic_feature;  ///< Mean over the Top-K, weights renormalised.
  Image<InstanceFeature> instance_feature;  ///< The same.
  RenderStats stats;
};

/// Scene -> images. An implementation holds one scene and its scratch memory, so one object
/// serves one thread; it may use many threads inside.
class Renderer {
 public:
  virtual ~Renderer() = default;
  Renderer() = default;
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  /// Renders into `frame`, whose allocations are reused.
  virtual void render(const CameraPose& T_world_camera, const CameraIntrinsics& intrinsics,
                      Channels channels, Frame& frame) = 0;

  [[nodiscard]] Frame render(const CameraPose& T_world_camera,
                             const CameraIntrinsics& intrinsics, Channels channels) {
    Frame frame;
    render(T_world_camera, intrinsics, channels, frame);
    return frame;
  }
};

}  // namespace segsim::core
