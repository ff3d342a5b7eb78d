#pragma once

/// @file
/// Who contributes to a pixel, in double precision, and how sure that is. It walks through
/// the reference renderer's surfels in their order, but intersects ray and disc by Cramer's
/// rule, and tells decisions that rounding may turn from those that it may not.

#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/camera.h"
#include "core/frames.h"
#include "renderer/internal/reference_surfels.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer::testing {

/// Relative distance of alpha from 1/255 within which a hit is undecided: what
/// cpu_renderer.h promises.
inline constexpr double kAlphaMargin = 1e-4;
/// The same for a fragment's depth and the near plane, where the low pass takes over.
inline constexpr double kNearMargin = 2e-5;
/// The same for the transmittance that finishes a pixel. Wider: near-opaque surfels multiply
/// the relative error of 1 - alpha.
inline constexpr double kStopMargin = 5e-3;

struct RayHit {
  double alpha;  ///< Before the threshold of 1/255; limited to kMaxAlpha.
  double depth_m;
  bool certain;  ///< Neither alpha nor the near plane are at a threshold.

  [[nodiscard]] bool visible() const { return 255.0 * alpha >= 1.0; }
};

/// Where the ray of an image position meets a surfel of ReferenceSurfels, by the definition in
/// surfel_geometry.h.
inline RayHit hit_of(const internal::ReferenceSurfel& s, const core::CameraIntrinsics& camera,
                     const glm::dvec2& px, double near_m) {
  // centre + a u + b v = t ray
  const glm::dvec3 ray = camera.back_project(px, 1.0);
  const double det = glm::dot(glm::cross(s.u_m, s.v_m), ray);
  const double t = glm::dot(glm::cross(s.u_m, s.v_m), s.centre_m) / det;
  const double a = glm::dot(glm::cross(s.v_m, s.centre_m), ray) / det;
  const double b = glm::dot(glm::cross(s.centre_m, s.u_m), ray) / det;
  const glm::dvec2 offset = px - s.low_pass_px;
  double rho = 2.0 * glm::dot(offset, offset);
  double depth_m = s.centre_m.z;
  bool certain = true;
  if (!s.edge_on) {
    const bool before_camera = t > 0.0 && std::isfinite(t);
    if (before_camera && t >= near_m) rho = std::fmin(rho, a * a + b * b);
    depth_m = before_camera ? t : s.z_max_m;
    certain = std::abs(t - near_m) > kNearMargin * near_m;
  }
  const double alpha =
      std::min(static_cast<double>(kMaxAlpha), s.opacity * std::exp(-0.5 * rho));
  certain &= std::abs(255.0 * alpha - 1.0) > kAlphaMargin;
  return {alpha, glm::clamp(depth_m, s.z_min_m, s.z_max_m), certain};
}

/// A surfel that a pixel blends, or may blend.
struct Contributor {
  std::size_t surfel;
  double weight;  ///< alpha T
  double depth_m;
  bool certain;  ///< False: alpha is at the threshold, or the pixel may be finished before.
};

struct OraclePixel {
  std::vector<Contributor> contributors;  ///< In the order of blending.
  bool certain = true;                    ///< All contributors are.
  double transmittance = 1.0;
  double median_depth_m = 0.0;
  bool depth_certain = true;            ///< No surfel leaves T within 1e-4 of 1/2.
  glm::dvec3 colour{0.0}, normal{0.0};  ///< Weighted sums.
};

class BlendingOracle {
 public:
  BlendingOracle(std::shared_ptr<const SurfelCloud> cloud, const core::CameraPose& pose,
                 const core::CameraIntrinsics& camera, const RenderOptions& options = {})
      : cloud_(std::move(cloud)),
        camera_(camera),
        near_m_(options.near_m),
        surfels_(*cloud_, options, pose, camera) {}

  [[nodiscard]] const internal::ReferenceSurfels& surfels() const { return surfels_; }

  [[nodiscard]] OraclePixel pixel(int x, int y) const {
    OraclePixel pixel;
    bool may_be_finished = false;
    for (const internal::ReferenceSurfel& s : surfels_.sorted()) {
      const RayHit hit = hit_of(s, camera_, {x + 0.5, y + 0.5}, near_m_);
      if (hit.certain && !hit.visible()) continue;
      const double left = pixel.transmittance * (1.0 - hit.alpha);
      const double stop = static_cast<double>(kStopTransmittance);
      if (hit.visible() && left < stop * (1.0 - kStopMargin)) break;
      may_be_finished |= left < stop * (1.0 + kStopMargin);
      blend(s, hit, hit.certain && !may_be_finished, hit.visible() && left >= stop, pixel);
    }
    return pixel;
  }

 private:
  static void blend(const internal::ReferenceSurfel& s, const RayHit& hit, bool certain,
                    bool counts, OraclePixel& pixel) {
    const double weight = pixel.transmittance * hit.alpha;
    pixel.contributors.push_back({s.index, weight, hit.depth_m, certain});
    pixel.certain &= certain;
    if (!counts) return;
    if (pixel.transmittance > 1.0 - static_cast<double>(kMinSurfaceAlpha)) {
      pixel.median_depth_m = hit.depth_m;
    }
    pixel.transmittance -= weight;
    pixel.depth_certain &= std::abs(pixel.transmittance - 0.5) > 1e-4;
    pixel.colour += weight * s.colour;
    pixel.normal += weight * s.normal_world;
  }

  std::shared_ptr<const SurfelCloud> cloud_;
  core::CameraIntrinsics camera_;
  double near_m_;
  internal::ReferenceSurfels surfels_;
};

}  // namespace segsim::renderer::testing
