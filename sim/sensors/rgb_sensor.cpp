#include "sim/sensors/rgb_sensor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/check.h"

namespace segsim::sim {
namespace {

/// Steps of linear light that are told apart: the darkest two codes lie 5 of them apart.
constexpr int kLinearSteps = 1 << 14;

struct SrgbTables {
  std::array<float, 256> linear;                    ///< Of a code.
  std::array<std::uint8_t, kLinearSteps + 1> code;  ///< Of linear light in steps.

  SrgbTables() {
    for (std::size_t k = 0; k < linear.size(); ++k) {
      const double c = static_cast<double>(k) / 255.0;
      linear[k] =
          static_cast<float>(c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4));
    }
    for (std::size_t k = 0; k < code.size(); ++k) {
      const double l = static_cast<double>(k) / kLinearSteps;
      const double c = l <= 0.0031308 ? 12.92 * l : 1.055 * std::pow(l, 1.0 / 2.4) - 0.055;
      code[k] = static_cast<std::uint8_t>(std::lround(255.0 * c));
    }
  }
};

const SrgbTables& tables() {
  static const SrgbTables made;
  return made;
}

std::uint8_t encoded(const SrgbTables& srgb, float linear) {
  const float step = std::clamp(linear, 0.0F, 1.0F) * static_cast<float>(kLinearSteps) + 0.5F;
  return srgb.code[static_cast<std::size_t>(step)];
}

}  // namespace

std::vector<double> RgbModel::exposure_offsets_s() const {
  if (!blurs()) return {0.0};
  std::vector<double> offsets_s;
  offsets_s.reserve(static_cast<std::size_t>(sub_poses));
  for (int k = 0; k < sub_poses; ++k) {
    // Twice the middle of part k, counted from the middle of the exposure, is a whole number
    // of parts: the one in the middle is exactly 0.
    offsets_s.push_back(exposure_s * (2 * k + 1 - sub_poses) / (2.0 * sub_poses));
  }
  return offsets_s;
}

void ExposureMean::add(const core::Image<core::Rgb8>& rgb) {
  if (images_ == 0) {
    width_px_ = rgb.width_px();
    height_px_ = rgb.height_px();
    sum_.assign(3 * rgb.size(), 0.0F);
  }
  SEGSIM_CHECK(rgb.width_px() == width_px_ && rgb.height_px() == height_px_, "one size");
  const SrgbTables& srgb = tables();
  for (std::size_t k = 0; k < rgb.size(); ++k) {
    const core::Rgb8 c = rgb.pixels()[k];
    sum_[3 * k] += srgb.linear[c.r];
    sum_[3 * k + 1] += srgb.linear[c.g];
    sum_[3 * k + 2] += srgb.linear[c.b];
  }
  ++images_;
}

void ExposureMean::finish(core::Image<core::Rgb8>& rgb) {
  SEGSIM_CHECK(images_ > 0, "a mean of no image");
  const SrgbTables& srgb = tables();
  const float share = 1.0F / static_cast<float>(images_);
  rgb.resize(width_px_, height_px_);
  for (std::size_t k = 0; k < rgb.size(); ++k) {
    rgb.pixels()[k] = {encoded(srgb, sum_[3 * k] * share),
                       encoded(srgb, sum_[3 * k + 1] * share),
                       encoded(srgb, sum_[3 * k + 2] * share)};
  }
  images_ = 0;
}

void add_rgb_noise(const RgbModel& model, const PixelNoise& noise,
                   core::Image<core::Rgb8>& rgb) {
  if (model.full_well_e <= 0.0) return;
  const SrgbTables& srgb = tables();
  std::array<float, 256> sigma;  // Of a code: the signal decides it.
  const double read = model.read_noise_e / model.full_well_e;
  for (std::size_t k = 0; k < sigma.size(); ++k) {
    sigma[k] = static_cast<float>(
        std::sqrt(double{srgb.linear[k]} / model.full_well_e + read * read));
  }
  std::array<std::vector<float>, 3> normal;
  constexpr std::size_t kPart_px = 4096;
  for (auto& channel : normal) channel.resize(kPart_px);
  for (std::size_t start = 0; start < rgb.size(); start += kPart_px) {
    const std::size_t count = std::min(kPart_px, rgb.size() - start);
    for (std::uint32_t layer = 0; layer < 3; ++layer) {
      noise.fill_normal(layer, static_cast<std::uint32_t>(start),
                        std::span(normal[layer]).first(count));
    }
    for (std::size_t k = 0; k < count; ++k) {
      core::Rgb8& c = rgb.pixels()[start + k];
      c = {encoded(srgb, srgb.linear[c.r] + sigma[c.r] * normal[0][k]),
           encoded(srgb, srgb.linear[c.g] + sigma[c.g] * normal[1][k]),
           encoded(srgb, srgb.linear[c.b] + sigma[c.b] * normal[2][k])};
    }
  }
}

void compress_jpeg(const RgbModel& model, core::Image<core::Rgb8>& rgb) {
  if (model.jpeg_quality <= 0 || rgb.empty()) return;
  const cv::Mat image(rgb.height_px(), rgb.width_px(), CV_8UC3, rgb.data());
  cv::Mat bgr;
  cv::cvtColor(image, bgr, cv::COLOR_RGB2BGR);
  std::vector<std::uint8_t> file;
  SEGSIM_CHECK(cv::imencode(".jpg", bgr, file, {cv::IMWRITE_JPEG_QUALITY, model.jpeg_quality}),
               "JPEG");
  bgr = cv::imdecode(file, cv::IMREAD_COLOR);
  SEGSIM_CHECK(bgr.rows == rgb.height_px() && bgr.cols == rgb.width_px(), "JPEG");
  cv::Mat back(rgb.height_px(), rgb.width_px(), CV_8UC3, rgb.data());
  cv::cvtColor(bgr, back, cv::COLOR_BGR2RGB);
}

}  // namespace segsim::sim
