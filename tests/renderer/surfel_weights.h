#pragma once

/// @file
/// Views of three kinds of scenes, and the weights of all surfels in all pixels of the fast
/// renderer's pictures of them.
///
/// A frame does not name the surfels of its pixels. But with K = all a pixel's feature is the
/// mean over all surfels that it blended: if one surfel has the feature (1, 0, 0, ...), the
/// next one (0, 1, 0, ...) and so on, it spells out their shares of alpha. As many pictures
/// as it takes give the weights of all surfels.

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "core/frames.h"
#include "renderer/cpu_renderer.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer::testing {

/// Not a multiple of the tile, principal point off the centre, pixels not square.
inline const core::CameraIntrinsics kOddCamera{51, 38, 45.0, 42.0, 24.3, 19.8};

/// Features that one picture has room for.
inline constexpr std::size_t kPerPicture =
    core::kSemanticFeatureSize + core::kInstanceFeatureSize;

struct View {
  std::shared_ptr<const SurfelCloud> scene;
  core::CameraPose pose;
};

/// Adds an opaque disc far behind everything: every pixel then has a surface, and features.
inline View with_backdrop(SurfelCloud cloud, const core::CameraPose& pose) {
  constexpr float kDistanceM = 40.0F;
  const glm::vec3 forward(pose.rotation() * glm::dvec3(0.0, 0.0, 1.0));
  Surfel surfel;
  surfel.position_m = glm::vec3(pose.translation_m()) + kDistanceM * forward;
  surfel.R_world_surfel = facing(-forward);
  surfel.scale_m = glm::vec2(10.0F * kDistanceM);
  surfel.opacity = 1.0F;
  surfel.semantic = 40, surfel.instance = 41;
  add(cloud, surfel);
  return {std::make_shared<const SurfelCloud>(std::move(cloud)), pose};
}

enum class SceneKind { kOutside, kInside, kRoom };

/// For INSTANTIATE_TEST_SUITE_P.
inline std::string name_of(SceneKind kind) {
  return kind == SceneKind::kOutside  ? "Outside"
         : kind == SceneKind::kInside ? "Inside"
                                      : "Room";
}

inline View view_of(SceneKind kind, int i) {
  const double a = std::numbers::pi * i / 4.0;
  const glm::dvec3 side(std::cos(a), std::sin(a), 0.3 * std::sin(2.0 * a));
  const auto seed = static_cast<std::uint64_t>(i);
  switch (kind) {
    case SceneKind::kOutside:
      return with_backdrop(random_scene(200 + seed, 900),
                           core::look_at(4.2 * side, {0.1, 0.0, -0.1}));
    case SceneKind::kInside:  // Many discs reach through the camera.
      return with_backdrop(random_scene(300 + seed, 1800),
                           core::look_at(0.2 * side, 1.3 * side));
    default:
      const glm::dvec3 middle(3.0, 2.5, 1.3);
      return with_backdrop(room_scene(0.4F),
                           core::look_at(middle + 0.4 * side, middle - 2.0 * side));
  }
}

/// Weights of one pixel by surfel; 0: does not contribute.
using Weights = std::vector<float>;

/// The weights of every surfel in every pixel of the fast renderer's picture.
inline std::vector<Weights> weights_of(const View& view) {
  const std::size_t surfels = view.scene->size();
  const auto pixels = static_cast<std::size_t>(kOddCamera.width_px) *
                      static_cast<std::size_t>(kOddCamera.height_px);
  std::vector<Weights> weights(pixels, Weights(surfels, 0.0F));
  core::Frame frame;
  for (std::size_t first = 0; first < surfels; first += kPerPicture) {
    const std::size_t count = std::min(kPerPicture, surfels - first);
    SurfelCloud cloud = *view.scene;
    cloud.semantic_feature.assign(surfels, {});
    cloud.instance_feature.assign(surfels, {});
    for (std::size_t k = 0; k < count; ++k) {
      if (k < core::kSemanticFeatureSize) {
        cloud.semantic_feature[first + k][k] = 1.0F;
      } else {
        cloud.instance_feature[first + k][k - core::kSemanticFeatureSize] = 1.0F;
      }
    }
    make_cpu_renderer(std::make_shared<const SurfelCloud>(std::move(cloud)),
                      {.top_k = kAllSurfels, .threads = 1})
        ->render(view.pose, kOddCamera, core::Channels::kFeatures, frame);
    for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
      for (std::size_t k = 0; k < count; ++k) {
        const float share =
            k < core::kSemanticFeatureSize
                ? frame.semantic_feature.pixels()[pixel][k]
                : frame.instance_feature.pixels()[pixel][k - core::kSemanticFeatureSize];
        weights[pixel][first + k] = share * frame.alpha.pixels()[pixel];
      }
    }
  }
  return weights;
}

}  // namespace segsim::renderer::testing
