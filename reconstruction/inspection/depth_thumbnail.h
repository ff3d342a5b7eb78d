#pragma once

/// @file
/// Small depth images, of which thousands fit into memory, and how far two of them tell of the
/// same surfaces.

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"

namespace segsim::reconstruction {

struct DepthThumbnail {
  core::Image<float> depth_m;  ///< Every so many-th pixel; NaN = none. Empty without depth.
  core::CameraIntrinsics camera;
};

/// @param intrinsics  Of the view, at any size.
[[nodiscard]] DepthThumbnail make_depth_thumbnail(const core::Image<float>& depth_m,
                                                  const core::CameraIntrinsics& intrinsics);

/// Depth at an image position, between four pixels of one surface; NaN elsewhere.
[[nodiscard]] double depth_between_m(const DepthThumbnail& thumbnail, const glm::dvec2& px);

struct DepthAgreement {
  int points = 0;               ///< Measured by A.
  int landed = 0;               ///< Of these, where B measured something.
  int matched = 0;              ///< Of these, within 3 % of B's depth.
  double median_error_m = 0.0;  ///< |depth from A - depth of B| where landed; 0 if nowhere.

  [[nodiscard]] double matched_share() const {
    return points > 0 ? static_cast<double>(matched) / points : 0.0;
  }
  [[nodiscard]] double matched_of_landed() const {
    return landed > 0 ? static_cast<double>(matched) / landed : 0.0;
  }
};

/// Points of A seen from B.
/// @param scale  What lengths of T_b_a are multiplied with.
/// @param step  Every so many-th pixel of A in both directions.
[[nodiscard]] DepthAgreement compare_depth(
    const DepthThumbnail& a, const DepthThumbnail& b,
    const core::Transform<core::frame::Camera, core::frame::Camera>& T_b_a, double scale = 1.0,
    int step = 2);

}  // namespace segsim::reconstruction
