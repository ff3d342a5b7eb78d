#pragma once

/// @file
/// Surfel parameters -> surfels on the screen and in the tiles' lists, for one view.

#include <cstdint>
#include <memory>
#include <vector>

#include "core/camera.h"
#include "reconstruction/rasterizer/surfel_adjoint.h"
#include "reconstruction/rasterizer/surfel_parameters.h"
#include "renderer/raster/tile_binning.h"
#include "renderer/scene/parallel.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::reconstruction::internal {

/// Inference's default: training sees what the robot will see.
inline constexpr float kTrainingNearM = renderer::RenderOptions{}.near_m;

template <class Real>
struct alignas(32) ViewSurfel {
  DrawnSurfel<Real> drawn;
  std::uint16_t x_lo, x_hi, y_lo, y_hi;  ///< Pixels whose centres the surfel can reach.
};

struct ViewCamera {
  renderer::ProjectionCamera<double> exact;
  renderer::ProjectionCamera<float>
      key;  ///< Of depth_of_centre(): the same order as inference.
  int width_px, height_px;
};

template <class Real>
class ViewSurfels {
 public:
  /// Enters every surfel that reaches the image in the slab of `bins`, which must be open;
  /// slots are indices of surfels.
  void project(const SurfelParameters<Real>& surfels, const ViewCamera& camera,
               renderer::internal::Workers& workers, renderer::internal::TileBins& bins);

  /// Indexed by surfel; undefined for those in no list.
  [[nodiscard]] const ViewSurfel<Real>* data() const { return surfels_.get(); }

 private:
  std::unique_ptr<ViewSurfel<Real>[]> surfels_;
  std::int64_t capacity_ = 0;
};

template <class Real>
[[nodiscard]] renderer::ProjectionCamera<Real> camera_as(
    const renderer::ProjectionCamera<double>& c) {
  const auto vec = [](const renderer::Vec3<double>& v) {
    return renderer::Vec3<Real>{static_cast<Real>(v.x), static_cast<Real>(v.y),
                                static_cast<Real>(v.z)};
  };
  return {vec(c.right),
          vec(c.down),
          vec(c.forward),
          vec(c.centre_m),
          static_cast<Real>(c.fx_px),
          static_cast<Real>(c.fy_px),
          static_cast<Real>(c.cx_px),
          static_cast<Real>(c.cy_px)};
}

}  // namespace segsim::reconstruction::internal
