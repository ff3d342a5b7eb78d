#include "reconstruction/evaluation/image_quality.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::reconstruction {
namespace {

constexpr std::array kChannels{&core::Rgb8::r, &core::Rgb8::g, &core::Rgb8::b};
constexpr int kRadius_px = 5;
constexpr int kWindow_px = 2 * kRadius_px + 1;
constexpr double kC1 = (0.01 * 255.0) * (0.01 * 255.0), kC2 = (0.03 * 255.0) * (0.03 * 255.0);

template <class A, class B>
void check_sizes(const core::Image<A>& image, const core::Image<B>& truth) {
  SEGSIM_CHECK(image.width_px() == truth.width_px() &&
                   image.height_px() == truth.height_px() && !image.empty(),
               std::to_string(image.width_px()) + "x" + std::to_string(image.height_px()) +
                   " against " + std::to_string(truth.width_px()) + "x" +
                   std::to_string(truth.height_px()));
}

std::array<double, kWindow_px> gaussian_window() {
  std::array<double, kWindow_px> window{};
  double sum = 0.0;
  for (int i = 0; i < kWindow_px; ++i) {
    const double x = i - kRadius_px;
    sum += window[static_cast<std::size_t>(i)] = std::exp(-x * x / (2.0 * 1.5 * 1.5));
  }
  for (double& weight : window) weight /= sum;
  return window;
}

/// First and second moments of the two images in a window.
enum Moment : std::uint8_t { kA, kB, kAA, kBB, kAB, kMoments };
using Moments = std::array<std::vector<double>, kMoments>;  // One row each.

/// Horizontal pass: windowed moments of one row.
void filter_row(const std::vector<double>& a, const std::vector<double>& b,
                const std::array<double, kWindow_px>& window, Moments& out) {
  const int width_px = static_cast<int>(a.size());
  for (std::vector<double>& row : out) row.assign(a.size(), 0.0);
  for (int tap = 0; tap < kWindow_px; ++tap) {
    const int offset = tap - kRadius_px;
    const double weight = window[static_cast<std::size_t>(tap)];
    const int begin = std::max(0, -offset), end = std::min(width_px, width_px - offset);
    for (int x = begin; x < end; ++x) {
      const auto i = static_cast<std::size_t>(x);
      const double va = a[static_cast<std::size_t>(x + offset)];
      const double vb = b[static_cast<std::size_t>(x + offset)];
      out[kA][i] += weight * va, out[kB][i] += weight * vb;
      out[kAA][i] += weight * va * va, out[kBB][i] += weight * vb * vb;
      out[kAB][i] += weight * va * vb;
    }
  }
}

double similarity(double a, double b, double aa, double bb, double ab) {
  const double variances = (aa - a * a) + (bb - b * b);
  return (2.0 * a * b + kC1) * (2.0 * (ab - a * b) + kC2) /
         ((a * a + b * b + kC1) * (variances + kC2));
}

/// Sum of the similarities of the pixels of row y in [x_begin, x_end); `rows` is a ring.
double row_similarity(const std::vector<Moments>& rows, int y, int height_px, int x_begin,
                      int x_end, const std::array<double, kWindow_px>& window) {
  double sum = 0.0;
  for (int x = x_begin; x < x_end; ++x) {
    std::array<double, kMoments> m{};
    for (int tap = 0; tap < kWindow_px; ++tap) {
      const int source = y + tap - kRadius_px;
      if (source < 0 || source >= height_px) continue;
      const Moments& row = rows[static_cast<std::size_t>(source % kWindow_px)];
      for (std::size_t k = 0; k < kMoments; ++k) {
        m[k] += window[static_cast<std::size_t>(tap)] * row[k][static_cast<std::size_t>(x)];
      }
    }
    sum += similarity(m[kA], m[kB], m[kAA], m[kBB], m[kAB]);
  }
  return sum;
}

double ssim_of_channel(const core::Image<core::Rgb8>& image,
                       const core::Image<core::Rgb8>& truth, std::uint8_t core::Rgb8::*channel,
                       SsimBorder border) {
  static const std::array<double, kWindow_px> window = gaussian_window();
  const int width_px = image.width_px(), height_px = image.height_px();
  const int margin = border == SsimBorder::kValid ? kRadius_px : 0;
  std::vector<Moments> rows(kWindow_px);  // Row y is at y % kWindow_px.
  std::vector<double> a(static_cast<std::size_t>(width_px)), b(a.size());
  double sum = 0.0;
  for (int y = -kRadius_px; y < height_px - margin; ++y) {
    if (const int next = y + kRadius_px; next < height_px) {
      for (int x = 0; x < width_px; ++x) {
        a[static_cast<std::size_t>(x)] = image(x, next).*channel;
        b[static_cast<std::size_t>(x)] = truth(x, next).*channel;
      }
      filter_row(a, b, window, rows[static_cast<std::size_t>(next % kWindow_px)]);
    }
    if (y >= margin)
      sum += row_similarity(rows, y, height_px, margin, width_px - margin, window);
  }
  return sum / (static_cast<double>(width_px - 2 * margin) * (height_px - 2 * margin));
}

double mean_of(double sum, std::uint64_t count) {
  return count == 0 ? 0.0 : sum / static_cast<double>(count);
}

bool is_depth(float depth_m) { return std::isfinite(depth_m) && depth_m > 0.0F; }

}  // namespace

double psnr_db(const core::Image<core::Rgb8>& image, const core::Image<core::Rgb8>& truth) {
  check_sizes(image, truth);
  std::uint64_t squares = 0;
  for (std::size_t i = 0; i < image.size(); ++i) {
    const core::Rgb8 a = image.pixels()[i], b = truth.pixels()[i];
    for (const int difference : {a.r - b.r, a.g - b.g, a.b - b.b}) {
      squares += static_cast<std::uint64_t>(difference * difference);
    }
  }
  if (squares == 0) return std::numeric_limits<double>::infinity();
  const double mean = static_cast<double>(squares) / (3.0 * static_cast<double>(image.size()));
  return 10.0 * std::log10(255.0 * 255.0 / mean);
}

double ssim(const core::Image<core::Rgb8>& image, const core::Image<core::Rgb8>& truth,
            SsimBorder border) {
  check_sizes(image, truth);
  if (border == SsimBorder::kValid) {
    SEGSIM_CHECK(std::min(image.width_px(), image.height_px()) >= kWindow_px,
                 "an image smaller than the window");
  }
  double sum = 0.0;
  for (const auto channel : {&core::Rgb8::r, &core::Rgb8::g, &core::Rgb8::b}) {
    sum += ssim_of_channel(image, truth, channel, border);
  }
  return sum / 3.0;
}

core::Image<core::Rgb8> gain_fitted(const core::Image<core::Rgb8>& image,
                                    const core::Image<core::Rgb8>& truth) {
  check_sizes(image, truth);
  Exposure exposure;
  for (int c = 0; c < 3; ++c) {
    const auto channel = kChannels[static_cast<std::size_t>(c)];
    // Least squares of gain * image = truth.
    double product = 0.0, square = 0.0;
    for (std::size_t i = 0; i < image.size(); ++i) {
      const double value = image.pixels()[i].*channel;
      product += value * (truth.pixels()[i].*channel);
      square += value * value;
    }
    if (square > 0.0) exposure.gain[c] = static_cast<float>(product / square);
  }
  return exposed(image, exposure);
}

core::Image<core::Rgb8> exposed(const core::Image<core::Rgb8>& image,
                                const Exposure& exposure) {
  core::Image<core::Rgb8> result = image;
  for (core::Rgb8& pixel : result.pixels()) {
    for (int c = 0; c < 3; ++c) {
      std::uint8_t& value = pixel.*kChannels[static_cast<std::size_t>(c)];
      const float bright =
          exposure.gain[c] * static_cast<float>(value) + 255.0F * exposure.offset[c];
      value = static_cast<std::uint8_t>(std::clamp(std::round(bright), 0.0F, 255.0F));
    }
  }
  return result;
}

void ColorQuality::add(const core::Image<core::Rgb8>& image,
                       const core::Image<core::Rgb8>& truth) {
  psnr_sum_db_ += reconstruction::psnr_db(image, truth);
  ssim_sum_ += reconstruction::ssim(image, truth);
  ++views_;
}
double ColorQuality::psnr_db() const { return psnr_sum_db_ / std::max(views_, 1); }
double ColorQuality::ssim() const { return ssim_sum_ / std::max(views_, 1); }

void DepthQuality::add(const core::Image<float>& depth_m, const core::Image<float>& truth_m) {
  check_sizes(depth_m, truth_m);
  for (std::size_t i = 0; i < depth_m.size(); ++i) {
    const float depth = depth_m.pixels()[i], truth = truth_m.pixels()[i];
    if (!is_depth(truth)) continue;
    if (!is_depth(depth)) {
      ++missing_;
      continue;
    }
    const double error_m = std::abs(static_cast<double>(depth) - truth);
    ++pixels_;
    abs_sum_m_ += error_m;
    square_sum_m2_ += error_m * error_m;
    ++by_mm_[static_cast<std::size_t>(1000.0 * std::min(error_m, kMedianLimit_m))];
    relative_sum_ += error_m / truth;
    close_ += std::max(depth / truth, truth / depth) < 1.25F ? 1 : 0;
  }
}
double DepthQuality::mean_abs_m() const { return mean_of(abs_sum_m_, pixels_); }
double DepthQuality::median_abs_m() const {
  std::uint64_t below = 0;
  for (std::size_t mm = 0; mm < by_mm_.size(); ++mm) {
    below += by_mm_[mm];
    if (2 * below >= pixels_ && pixels_ > 0) return 1e-3 * static_cast<double>(mm);
  }
  return 0.0;
}
double DepthQuality::rms_m() const { return std::sqrt(mean_of(square_sum_m2_, pixels_)); }
double DepthQuality::mean_relative() const { return mean_of(relative_sum_, pixels_); }
double DepthQuality::within_1_25() const {
  return mean_of(static_cast<double>(close_), pixels_);
}
double DepthQuality::completeness() const {
  return mean_of(static_cast<double>(pixels_), pixels_ + missing_);
}

void NormalQuality::add(const core::Image<glm::vec3>& normal,
                        const core::Image<glm::vec3>& truth) {
  check_sizes(normal, truth);
  constexpr double kDegree = std::numbers::pi / 180.0;
  constexpr std::array kThresholds_rad{11.25 * kDegree, 22.5 * kDegree, 30.0 * kDegree};
  for (std::size_t i = 0; i < normal.size(); ++i) {
    const glm::dvec3 a(normal.pixels()[i]), b(truth.pixels()[i]);
    if (!(glm::dot(a, a) > 0.25) || !(glm::dot(b, b) > 0.25)) continue;  // 0 or NaN.
    // Accurate at small angles too, where acos of the product is not.
    const double angle_rad = std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
    ++pixels_;
    angle_sum_rad_ += angle_rad;
    for (std::size_t k = 0; k < kThresholds_rad.size(); ++k) {
      within_[k] += angle_rad < kThresholds_rad[k] ? 1 : 0;
    }
  }
}
double NormalQuality::mean_rad() const { return mean_of(angle_sum_rad_, pixels_); }
std::array<double, 3> NormalQuality::within() const {
  std::array<double, 3> shares{};
  for (std::size_t k = 0; k < shares.size(); ++k) {
    shares[k] = mean_of(static_cast<double>(within_[k]), pixels_);
  }
  return shares;
}

}  // namespace segsim::reconstruction
