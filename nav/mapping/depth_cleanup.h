#pragma once

/// @file
/// What VLFM does to a depth image before it maps it (depth_camera_filtering at 39d6e2f, after
/// the hole filling of IP-Basic, Ku et al. 2018), and what is done here instead.

#include "core/camera.h"
#include "core/image.h"
#include "nav/mapping/vlfm_rules.h"

namespace segsim::nav {

struct DepthCleanupOptions {
  double min_depth_m = 0.5, max_depth_m = 5.0;  ///< Range that [0, 1] stands for.
  double hole_area_px2 = 100'000.0;             ///< Smaller regions still empty count as far.
};

/// Depth as Habitat delivers it: clipped to the range, (z - min) / (max - min); no measurement
/// (NaN, <= 0) is 0. Infinite depth is 1.
[[nodiscard]] core::Image<float> normalised_depth(const core::Image<float>& depth_m,
                                                  const DepthCleanupOptions& options);

/// Fills zeros of a normalised image from their surroundings; other pixels stay as they are.
/// Values up to 0.1 count as empty inside the filter, as published.
[[nodiscard]] core::Image<float> filled_depth(const core::Image<float>& normalised);

/// Sets zero regions whose outline encloses less than `hole_area_px2` to 1 (far).
void set_holes_far(core::Image<float>& normalised, const DepthCleanupOptions& options);

/// The metric depth that is mapped: the two steps above where quirk Q8 is published; else the
/// image as it is, with NaN for every pixel that is no measurement within [0, max_depth_m).
void clean_depth_m(const core::Image<float>& depth_m, const VlfmRules& rules,
                   const DepthCleanupOptions& options, core::Image<float>& cleaned_m);

/// Depth that a network inferred from colour, brought to [0, 1] (VLFM's Spot variant). As
/// published (quirk Q13) the minimum is not subtracted: z / (max - min).
[[nodiscard]] double normalised_inferred(double depth_m, const VlfmRules& rules,
                                         const DepthCleanupOptions& options);

/// Of an image that is this wide every n-th pixel suffices for maps: at 5 m a cell of 5 cm
/// still covers two pixels of an image of 320 px.
[[nodiscard]] int thinning_of(const core::Image<float>& depth_m);

/// Every n-th pixel of every n-th row.
void thin_out(const core::Image<float>& depth_m, int n, core::Image<float>& thin_m);

/// The camera of the thinned image.
[[nodiscard]] core::CameraIntrinsics thinned_camera(const core::CameraIntrinsics& camera,
                                                    int n);

}  // namespace segsim::nav
