#pragma once

/// @file
/// From a rendered colour image to what a camera delivers:
///
///     sub-poses of the exposure -> mean in linear light -> shot and read noise -> sRGB ->
///     JPEG
///
/// Light adds up on the sensor, so the mean of the exposure and the noise of photons are
/// computed in linear light (IEC 61966-2-1 undone), not in the sRGB code of the renderer,
/// where a mean of black and white would come out too dark. For a linear signal L in [0, 1]
/// the noise is normal with
///
///     sigma(L)^2 = L / W + (r / W)^2        (W: full well, r: read noise, both in electrons)
///
/// the shot noise of N = L W photo-electrons, and the amplifier's. Colours are not
/// mosaicked.

#include <vector>

#include "core/image.h"
#include "sim/sensors/pixel_noise.h"

namespace segsim::sim {

struct RgbModel {
  double exposure_s = 0.0;    ///< How long the shutter is open, around the capture time.
  int sub_poses = 1;          ///< Images that are averaged over it; 1: no blur.
  double full_well_e = 0.0;   ///< Electrons at white; 0: neither shot nor read noise.
  double read_noise_e = 0.0;  ///< Standard deviation [electrons].
  int jpeg_quality = 0;       ///< 1 .. 100; 0: not compressed.

  [[nodiscard]] bool blurs() const { return sub_poses > 1 && exposure_s > 0.0; }
  /// Middles of the `sub_poses` equal parts of the exposure, relative to the capture time [s].
  [[nodiscard]] std::vector<double> exposure_offsets_s() const;
};

/// The mean of several images of one size in linear light.
class ExposureMean {
 public:
  void add(const core::Image<core::Rgb8>& rgb);
  /// The mean; the next add() begins anew. @pre add() was called.
  void finish(core::Image<core::Rgb8>& rgb);

 private:
  std::vector<float> sum_;  ///< 3 per pixel.
  int width_px_ = 0, height_px_ = 0, images_ = 0;
};

/// Shot and read noise. Nothing happens if `model.full_well_e` is 0.
void add_rgb_noise(const RgbModel& model, const PixelNoise& noise,
                   core::Image<core::Rgb8>& rgb);

/// What is left after JPEG (4:2:0, as OpenCV's codec does it). Nothing happens if
/// `model.jpeg_quality` is 0.
void compress_jpeg(const RgbModel& model, core::Image<core::Rgb8>& rgb);

}  // namespace segsim::sim
