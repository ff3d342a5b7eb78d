#include "reconstruction/rasterizer/internal/view_surfels.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "reconstruction/rasterizer/surfel_activation.h"
#include "renderer/raster/tile_size.h"

namespace segsim::reconstruction::internal {
namespace {

/// Rounding of the projected centre and outline stays below this [px].
constexpr double kPixelSlack = 2e-3;
/// Surfels of a task.
constexpr std::size_t kSurfelsPerTask = 2048;

template <class Real>
renderer::Vec3<float> narrow(const renderer::Vec3<Real>& v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

/// The pyramid of the image, widened by the low pass, for spheres in the camera's frame.
template <class Real>
class Frustum {
 public:
  Frustum(const renderer::ProjectionCamera<Real>& c, int width_px, int height_px)
      : x_lo_((-kMarginPx - c.cx_px) / c.fx_px),
        x_hi_((static_cast<Real>(width_px) + kMarginPx - c.cx_px) / c.fx_px),
        y_lo_((-kMarginPx - c.cy_px) / c.fy_px),
        y_hi_((static_cast<Real>(height_px) + kMarginPx - c.cy_px) / c.fy_px),
        steepest_(std::sqrt(Real(1) + std::max(std::max(x_lo_ * x_lo_, x_hi_ * x_hi_),
                                               std::max(y_lo_ * y_lo_, y_hi_ * y_hi_)))) {}

  /// @param z  Of the centre, > 0.
  [[nodiscard]] bool misses(Real x, Real y, Real z, Real radius) const {
    const Real r = radius * steepest_;
    return x < z * x_lo_ - r || x > z * x_hi_ + r || y < z * y_lo_ - r || y > z * y_hi_ + r;
  }

 private:
  static constexpr Real kMarginPx = 3;
  Real x_lo_, x_hi_, y_lo_, y_hi_, steepest_;
};

/// Enters a surfel in the tile rows of its outline.
/// @param outline  Null: the surfel's pixel range decides.
template <class Real>
void add_tiles(const ViewSurfel<Real>& s, const renderer::ScreenEllipse<Real>* outline,
               const ViewCamera& camera, renderer::internal::DepthSlot entry,
               renderer::internal::TileWriter& writer) {
  const int x_begin = s.x_lo / renderer::internal::kTileSizePx,
            x_end = s.x_hi / renderer::internal::kTileSizePx + 1;
  const int y_begin = s.y_lo / renderer::internal::kTileSizePx,
            y_end = s.y_hi / renderer::internal::kTileSizePx + 1;
  const bool inside = s.x_lo > 0 && s.y_lo > 0 && s.x_hi < camera.width_px - 1 &&
                      s.y_hi < camera.height_px - 1;
  const bool narrow = x_end - x_begin < 2 || y_end - y_begin < 2;
  if (outline == nullptr || (inside && narrow)) {
    for (int y = y_begin; y < y_end; ++y) writer.add_row(y, x_begin, x_end, entry);
    return;
  }
  constexpr Real kTile = renderer::internal::kTileSizePx;
  for (int y = y_begin; y < y_end; ++y) {
    const Real first_row = static_cast<Real>(y) * kTile + Real(0.5);
    const renderer::ColumnSpan<Real> span = renderer::columns_in_band(
        *outline, s.drawn.x0_px, s.drawn.y0_px,
        Real(0.5) * s.drawn.k2 * Real(renderer::kBoundSlack), first_row - Real(kPixelSlack),
        first_row + kTile - Real(1) + Real(kPixelSlack));
    if (!(span.x_min_px <= span.x_max_px)) continue;
    const Real slack = Real(kPixelSlack) + Real(1e-4) * (span.x_max_px - span.x_min_px);
    const Real lo = std::ceil((span.x_min_px - slack - (kTile - Real(0.5))) / kTile);
    const Real hi = std::floor((span.x_max_px + slack - Real(0.5)) / kTile) + Real(1);
    const int from = static_cast<int>(std::clamp(lo, Real(x_begin), Real(x_end)));
    const int to = static_cast<int>(std::clamp(hi, Real(x_begin), Real(x_end)));
    if (from < to) writer.add_row(y, from, to, entry);
  }
}

/// Projects the surfels of one view.
template <class Real>
class Projector {
 public:
  Projector(const SurfelParameters<Real>& surfels, const ViewCamera& view)
      : surfels_(surfels),
        view_(view),
        camera_(camera_as<Real>(view.exact)),
        frustum_(camera_, view.width_px, view.height_px) {}

  void project(std::int64_t i, ViewSurfel<Real>& out,
               renderer::internal::TileWriter& writer) const {
    const renderer::Vec3<Real> position = load_vec3(surfels_.position_m, i);
    const float key = renderer::depth_of_centre(view_.key, narrow(position));
    if (!(key > kTrainingNearM)) return;
    const renderer::Vec3<Real> offset = offset_of(camera_, position);
    const Real largest_scale =
        std::exp(std::max(surfels_.log_scale[2 * i], surfels_.log_scale[2 * i + 1]));
    constexpr auto kLargestExtent = Real(3.33);  // sqrt(2 ln 255), opacity 1.
    if (frustum_.misses(
            renderer::dot(camera_.right, offset), renderer::dot(camera_.down, offset),
            renderer::dot(camera_.forward, offset), kLargestExtent * largest_scale)) {
      return;
    }
    const Real k2 = renderer::extent_squared(active_opacity(surfels_.opacity_logit[i]));
    if (!(k2 > Real(0))) return;
    const ActiveSurfel<Real> active = activate(surfels_, i);
    const renderer::SurfelProjection<Real> screen =
        renderer::project_surfel(camera_, position, scaled(active.t_u, active.scale_u_m),
                                 scaled(active.t_v, active.scale_v_m));
    // What an optimiser that diverged leaves behind is not drawn.
    if (!std::isfinite((screen.a0 + screen.a1) + (screen.b0 + screen.b1) + screen.x0_px +
                       screen.y0_px)) {
      return;
    }
    renderer::ScreenEllipse<Real> outline{};
    const bool clipped = renderer::crosses_near_plane(screen, k2 * Real(renderer::kBoundSlack),
                                                      Real(kTrainingNearM));
    if (!find_pixels(screen, k2, clipped, outline, out)) return;
    out.drawn = drawn_surfel(active, screen, k2, Real(kTrainingNearM), camera_);
    out.drawn.colour = colour_of(surfels_, i, camera_);
    const renderer::internal::DepthSlot entry =
        renderer::internal::DepthSlot{std::bit_cast<std::uint32_t>(key)} << 32U |
        static_cast<renderer::internal::DepthSlot>(i);
    add_tiles(out, clipped ? nullptr : &outline, view_, entry, writer);
  }

 private:
  /// @return  False if the surfel reaches no pixel centre of the image.
  bool find_pixels(const renderer::SurfelProjection<Real>& screen, Real k2, bool clipped,
                   renderer::ScreenEllipse<Real>& outline, ViewSurfel<Real>& out) const {
    const Real k2_bound = k2 * Real(renderer::kBoundSlack);
    renderer::ScreenBox<Real> box;
    Real slack = Real(kPixelSlack);
    if (clipped) {
      box = renderer::box_of_clipped_disc(screen, k2_bound, Real(kTrainingNearM));
      // Offsets can be many thousand pixels here.
      slack += Real(1e-5) * std::max(box.x_max_px - box.x_min_px, box.y_max_px - box.y_min_px);
    } else {
      outline = renderer::outline_of_disc(screen, k2_bound);
      box = renderer::box_of(outline);
    }
    box = renderer::with_low_pass(box, screen, k2_bound);
    const auto right = static_cast<Real>(view_.width_px - 1);
    const auto bottom = static_cast<Real>(view_.height_px - 1);
    const Real x_lo = renderer::larger(std::ceil(box.x_min_px - Real(0.5) - slack), Real(0));
    const Real x_hi = renderer::lesser(std::floor(box.x_max_px - Real(0.5) + slack), right);
    const Real y_lo = renderer::larger(std::ceil(box.y_min_px - Real(0.5) - slack), Real(0));
    const Real y_hi = renderer::lesser(std::floor(box.y_max_px - Real(0.5) + slack), bottom);
    if (!(x_lo <= x_hi && y_lo <= y_hi && x_hi >= Real(0) && y_hi >= Real(0) &&
          x_lo <= right && y_lo <= bottom)) {
      return false;
    }
    out.x_lo = static_cast<std::uint16_t>(x_lo), out.x_hi = static_cast<std::uint16_t>(x_hi);
    out.y_lo = static_cast<std::uint16_t>(y_lo), out.y_hi = static_cast<std::uint16_t>(y_hi);
    return true;
  }

  const SurfelParameters<Real>& surfels_;
  const ViewCamera& view_;
  renderer::ProjectionCamera<Real> camera_;
  Frustum<Real> frustum_;
};

}  // namespace

template <class Real>
void ViewSurfels<Real>::project(const SurfelParameters<Real>& surfels,
                                const ViewCamera& camera, renderer::internal::Workers& workers,
                                renderer::internal::TileBins& bins) {
  if (capacity_ < surfels.count) {
    capacity_ = surfels.count;
    surfels_ = std::make_unique_for_overwrite<ViewSurfel<Real>[]>(
        static_cast<std::size_t>(capacity_));
  }
  const Projector<Real> projector(surfels, camera);
  const auto count = static_cast<std::size_t>(surfels.count);
  workers.for_each((count + kSurfelsPerTask - 1) / kSurfelsPerTask, [&](std::size_t task) {
    renderer::internal::TileWriter& writer = bins.writer(workers.thread_index());
    const std::size_t first = task * kSurfelsPerTask;
    for (std::size_t i = first; i < std::min(count, first + kSurfelsPerTask); ++i) {
      projector.project(static_cast<std::int64_t>(i), surfels_[i], writer);
    }
  });
}

template class ViewSurfels<float>;
template class ViewSurfels<double>;

}  // namespace segsim::reconstruction::internal
