#pragma once

/// @file
/// How close a rendered view is to the recorded one: colour, depth, normals. Each accumulator
/// takes view after view; figures of colour are means over views, as in the literature,
/// figures of depth and normals are over all pixels.

#include <array>
#include <cstdint>

#include <glm/vec3.hpp>

#include "core/image.h"

namespace segsim::reconstruction {

/// 10 log10(255^2 / mean squared error over pixels and channels); infinite if equal.
[[nodiscard]] double psnr_db(const core::Image<core::Rgb8>& image,
                             const core::Image<core::Rgb8>& truth);

enum class SsimBorder : std::uint8_t {
  kZeroPadded,  ///< All pixels, black around the image: what 3DGS and 2DGS report and train
                ///< on.
  kValid,       ///< Only pixels whose window lies in the image: Wang's own; needs 11 x 11.
};

/// Structural similarity (Wang et al., IEEE TIP 2004): Gaussian window of 11 x 11 with
/// sigma 1.5, K1 = 0.01, K2 = 0.03, mean over pixels and channels of the 8-bit values.
[[nodiscard]] double ssim(const core::Image<core::Rgb8>& image,
                          const core::Image<core::Rgb8>& truth,
                          SsimBorder border = SsimBorder::kZeroPadded);

/// `image` with each channel times the factor that brings it nearest to `truth` in the mean
/// square. What is left of the error is not the exposure's: a camera with automatic exposure
/// shows the same wall brighter or darker from view to view.
[[nodiscard]] core::Image<core::Rgb8> gain_fitted(const core::Image<core::Rgb8>& image,
                                                  const core::Image<core::Rgb8>& truth);

/// What a camera's automatics do to the colours of one view.
struct Exposure {
  glm::vec3 gain{1.0F}, offset{0.0F};  ///< Of red, green, blue in 0 ... 1.
};

/// gain * image + offset, within 0 ... 255.
[[nodiscard]] core::Image<core::Rgb8> exposed(const core::Image<core::Rgb8>& image,
                                              const Exposure& exposure);

/// Means over views.
class ColorQuality {
 public:
  void add(const core::Image<core::Rgb8>& image, const core::Image<core::Rgb8>& truth);
  [[nodiscard]] int views() const { return views_; }
  [[nodiscard]] double psnr_db() const;  ///< 0 without views.
  [[nodiscard]] double ssim() const;

 private:
  int views_ = 0;
  double psnr_sum_db_ = 0.0, ssim_sum_ = 0.0;
};

inline constexpr double kMedianLimit_m = 1.0;

/// Depth where both sides have one; NaN and values <= 0 mean "none".
class DepthQuality {
 public:
  void add(const core::Image<float>& depth_m, const core::Image<float>& truth_m);
  [[nodiscard]] std::uint64_t pixels() const { return pixels_; }
  [[nodiscard]] double mean_abs_m() const;  ///< "Depth L1". 0 without pixels, as the others.
  /// In whole millimetres, rounded down; errors from kMedianLimit_m on count as that.
  [[nodiscard]] double median_abs_m() const;
  [[nodiscard]] double rms_m() const;
  [[nodiscard]] double mean_relative() const;  ///< |d - d*| / d*.
  [[nodiscard]] double within_1_25() const;    ///< Share with max(d / d*, d* / d) < 1.25.
  /// Share of the pixels with a true depth that have a depth.
  [[nodiscard]] double completeness() const;

 private:
  std::uint64_t pixels_ = 0, missing_ = 0, close_ = 0;
  double abs_sum_m_ = 0.0, square_sum_m2_ = 0.0, relative_sum_ = 0.0;
  std::array<std::uint64_t, 1001> by_mm_{};  ///< Pixels by error; the last: all larger ones.
};

/// Angle between unit normals where both sides have one (not 0, not NaN).
class NormalQuality {
 public:
  void add(const core::Image<glm::vec3>& normal, const core::Image<glm::vec3>& truth);
  [[nodiscard]] std::uint64_t pixels() const { return pixels_; }
  [[nodiscard]] double mean_rad() const;
  /// Shares within 11.25, 22.5 and 30 degrees: the thresholds of Fouhey et al., ICCV 2013.
  [[nodiscard]] std::array<double, 3> within() const;

 private:
  std::uint64_t pixels_ = 0;
  double angle_sum_rad_ = 0.0;
  std::array<std::uint64_t, 3> within_{};
};

}  // namespace segsim::reconstruction
