#pragma once

/// @file
/// Between a tile's planes and the images of the whole view.

#include <algorithm>
#include <cstddef>

#include "reconstruction/rasterizer/internal/training_tile.h"

namespace segsim::reconstruction::internal {

/// Calls body(place in the tile, index of the pixel in the image) for the tile's pixels that
/// lie in the image.
template <class Real, class Body>
void for_each_pixel(const TileView<Real>& tile, int width_px, int height_px,
                    const Body& body) {
  const int columns = std::min(renderer::internal::kTileSizePx, width_px - tile.x_px);
  const int rows = std::min(renderer::internal::kTileSizePx, height_px - tile.y_px);
  for (int y = 0; y < rows; ++y) {
    const std::size_t row = static_cast<std::size_t>(tile.y_px + y) * width_px + tile.x_px;
    for (int x = 0; x < columns; ++x) {
      body(static_cast<std::size_t>(place_in_tile(x, y)), row + x);
    }
  }
}

template <class Real>
void begin_record(const TileView<Real>& tile, const ViewCamera& camera,
                  TileRecord<Real>& record) {
  record.end.fill(0);
  for_each_pixel(tile, camera.width_px, camera.height_px,
                 [&](std::size_t place, std::size_t) { record.end[place] = kOpenPixel; });
}

template <class Real>
void write_images(const TileView<Real>& tile, const TileRecord<Real>& record,
                  const TrainingImages<Real>& images) {
  for_each_pixel(tile, images.width_px, images.height_px,
                 [&](std::size_t place, std::size_t pixel) {
                   const PixelSums<Real> sums = record.sums(static_cast<int>(place));
                   images.rgb[3 * pixel] = sums.rgb.x;
                   images.rgb[3 * pixel + 1] = sums.rgb.y;
                   images.rgb[3 * pixel + 2] = sums.rgb.z;
                   images.depth_m[pixel] = sums.depth_m;
                   images.alpha[pixel] = Real(1) - sums.transmittance;
                   images.normal[3 * pixel] = sums.normal.x;
                   images.normal[3 * pixel + 1] = sums.normal.y;
                   images.normal[3 * pixel + 2] = sums.normal.z;
                   images.median_m[pixel] = sums.median_m;
                   if (images.distortion != nullptr) {
                     images.distortion[pixel] = distortion_of(sums);
                   }
                 });
}

template <class Real>
void read_loss(const TileView<Real>& tile, const TrainingImages<const Real>& images,
               TileLoss<Real>& loss) {
  loss = {};
  for_each_pixel(tile, images.width_px, images.height_px,
                 [&](std::size_t place, std::size_t pixel) {
                   if (images.rgb != nullptr) {
                     loss.r[place] = images.rgb[3 * pixel];
                     loss.g[place] = images.rgb[3 * pixel + 1];
                     loss.b[place] = images.rgb[3 * pixel + 2];
                   }
                   if (images.normal != nullptr) {
                     loss.nx[place] = images.normal[3 * pixel];
                     loss.ny[place] = images.normal[3 * pixel + 1];
                     loss.nz[place] = images.normal[3 * pixel + 2];
                   }
                   if (images.depth_m != nullptr) loss.depth_m[place] = images.depth_m[pixel];
                   if (images.alpha != nullptr) loss.alpha[place] = images.alpha[pixel];
                   if (images.distortion != nullptr) {
                     loss.distortion[place] = images.distortion[pixel];
                   }
                 });
}

}  // namespace segsim::reconstruction::internal
