#pragma once

/// @file
/// Where a projected surfel lies on the screen: exact outline, box, tiles of the box.

#include "renderer/cuda/device_data.h"
#include "renderer/cuda/tile_spans.cuh"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::cuda {

/// Rounding of the projected centre and outline stays below this.
inline constexpr float kPixelSlack = 1e-3F;

/// @param sphere  Centre in the world and radius [m].
/// @return  False if no disc in the sphere reaches the image.
__device__ inline bool sphere_in_view(float near_m, const ViewCamera& view,
                                      const float4& sphere) {
  const ProjectionCamera<float>& c = view.pinhole;
  const float r = sphere.w;
  const Vec3<float> offset{sphere.x - c.centre_m.x, sphere.y - c.centre_m.y,
                           sphere.z - c.centre_m.z};
  const float z = dot(c.forward, offset);
  const float x = dot(c.right, offset), y = dot(c.down, offset);
  return z + r >= near_m && view.slope[0] * z - x <= r * view.norm[0] &&
         x - view.slope[1] * z <= r * view.norm[1] &&
         view.slope[2] * z - y <= r * view.norm[2] &&
         y - view.slope[3] * z <= r * view.norm[3];
}

/// Pixels [x_lo, x_hi] x [y_lo, y_hi].
struct PixelRange {
  int x_lo, x_hi, y_lo, y_hi;
};

/// Pixels of the image with their centre in the box, a little widened. What is not a number (a
/// degenerate conic) means all.
/// @return  False if there are none.
__device__ inline bool find_pixels(const FrameView& frame, const ScreenBox<float>& box,
                                   PixelRange& out) {
  const float x_lo = fmaxf(ceilf(box.x_min_px - 0.5F - kPixelSlack), 0.0F);
  const float y_lo = fmaxf(ceilf(box.y_min_px - 0.5F - kPixelSlack), 0.0F);
  const float x_hi =
      fminf(floorf(box.x_max_px - 0.5F + kPixelSlack), static_cast<float>(frame.width_px - 1));
  const float y_hi = fminf(floorf(box.y_max_px - 0.5F + kPixelSlack),
                           static_cast<float>(frame.height_px - 1));
  out = {static_cast<int>(x_lo), static_cast<int>(x_hi), static_cast<int>(y_lo),
         static_cast<int>(y_hi)};
  return x_lo <= x_hi && y_lo <= y_hi;
}

__device__ inline void set_tiles(const PixelRange& pixels, Candidate& out) {
  out.x_begin = pixels.x_lo / kTilePx;
  out.y_begin = pixels.y_lo / kTilePx;
  out.x_end = pixels.x_hi / kTilePx + 1;
  out.y_end = pixels.y_hi / kTilePx + 1;
}

/// Tiles of find_pixels().
__device__ inline bool find_tiles(const FrameView& frame, const ScreenBox<float>& box,
                                  Candidate& out) {
  PixelRange pixels;
  const bool any = find_pixels(frame, box, pixels);
  set_tiles(pixels, out);
  return any;
}

/// Box of all pixels that a surfel can reach, low pass included.
/// @param clipped  crosses_near_plane(); there is no ellipse then.
__device__ inline ScreenBox<float> bound_on_screen(const SurfelProjection<float>& s, float k2,
                                                   float near_m, bool clipped,
                                                   ScreenEllipse<float>& outline) {
  const float k2_bound = k2 * kBoundSlack;
  ScreenBox<float> box;
  if (clipped) {
    box = with_low_pass(box_of_clipped_disc(s, k2_bound, near_m), s, k2_bound);
    // Offsets can be many thousand pixels here, so float rounding exceeds kPixelSlack.
    const float slack =
        1e-5F * fmaxf(box.x_max_px - box.x_min_px, box.y_max_px - box.y_min_px);
    box = {box.x_min_px - slack, box.x_max_px + slack, box.y_min_px - slack,
           box.y_max_px + slack};
    outline = {s.x0_px, s.y0_px, 0.0F, 0.0F, -1.0F};
  } else {
    outline = outline_of_disc(s, k2_bound);
    box = with_low_pass(box_of(outline), s, k2_bound);
  }
  return box;
}

}  // namespace segsim::renderer::cuda
