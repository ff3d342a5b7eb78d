#pragma once

/// @file
/// Matching cost of every pixel at every depth: pictures are warped onto planes parallel to
/// the image (Collins, CVPR 1996) and compared by normalised cross-correlation of 5 x 5
/// pixels.

#include <cstdint>
#include <span>
#include <vector>

#include "reconstruction/stereo/internal/source_views.h"
#include "reconstruction/stereo/internal/working_view.h"

namespace segsim::reconstruction::internal {

inline constexpr int kWorstCost = 100;

/// Planes equally far apart in inverse depth, as disparity is.
struct SweepPlanes {
  float first_inverse_m = 0.0F;  ///< Of plane 0, the farthest.
  float step_inverse_m = 0.0F;
  int count = 0;  ///< A multiple of 8.

  [[nodiscard]] float inverse_m(float plane) const {
    return first_inverse_m + plane * step_inverse_m;
  }
};

/// [height][width][planes]
struct CostVolume {
  int width_px = 0, height_px = 0;
  SweepPlanes planes;
  /// 0 = alike, kWorstCost = no correlation, or out of sight of all sources.
  std::vector<std::uint8_t> cost;

  [[nodiscard]] const std::uint8_t* at(int x, int y) const {
    return cost.data() + (static_cast<std::size_t>(y) * width_px + x) * planes.count;
  }
  [[nodiscard]] std::uint8_t* at(int x, int y) {
    return cost.data() + (static_cast<std::size_t>(y) * width_px + x) * planes.count;
  }
};

/// So many that a step moves the image in the sources by a pixel in the mean; 16 ... 192.
[[nodiscard]] SweepPlanes sweep_planes(const DepthRange& range,
                                       std::span<const ViewWarp> warps,
                                       const core::CameraIntrinsics& camera);

/// A pixel's cost at a plane is the mean of those of the better half of the sources, so that
/// one side may be hidden.
/// @param sources, warps  Of one length, at least 1.
[[nodiscard]] CostVolume sweep(const core::Image<std::uint16_t>& reference,
                               std::span<const core::Image<std::uint16_t>* const> sources,
                               std::span<const ViewWarp> warps, const SweepPlanes& planes);

/// Makes the depth of known points cheap at their pixels and the eight around.
/// @param points_m  Camera frame; those out of the picture or the planes do not count.
void seed_costs(std::span<const glm::vec3> points_m, const core::CameraIntrinsics& camera,
                CostVolume& volume);

}  // namespace segsim::reconstruction::internal
