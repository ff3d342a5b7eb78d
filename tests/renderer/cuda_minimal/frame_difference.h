#pragma once

/// @file
/// How far a frame is from the reference, and how far it may be: the tolerances of
/// cpu_renderer_test.cpp.

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>

#include <glm/geometric.hpp>

#include "core/render.h"

namespace segsim::renderer::testing {

struct FrameDifference {
  int pixels = 0, labelled = 0;
  int colour_off = 0, depth_off = 0, labels_off = 0, normal_off = 0, alpha_off = 0;
  int features_off = 0, poisoned = 0;
  int worst_colour = 0;
  double worst_depth = 0.0, squared_error = 0.0;

  [[nodiscard]] double psnr_db() const {
    return 10.0 * std::log10(255.0 * 255.0 * 3.0 * pixels / std::max(squared_error, 1e-9));
  }
  /// Colour within 1/255, alpha and depth within 1e-3 and labels equal on at least 99.9 % of
  /// the pixels: the rest may lie where a surfel's alpha passes 1/255 or a pixel's T 1e-4.
  [[nodiscard]] bool passes() const {
    const double allowed = std::max(1.0, 1e-3 * pixels);
    return colour_off <= allowed && worst_colour <= 6 && alpha_off <= allowed &&
           depth_off <= allowed && normal_off <= allowed && features_off <= allowed &&
           labels_off <= 1e-3 * labelled + 1.0 && poisoned == 0;
  }
  [[nodiscard]] std::string text() const {
    char line[256];
    std::snprintf(line, sizeof line,
                  "%6d px  colour %3d (worst %d, %.1f dB)  alpha %2d  depth %2d (worst %.1e)  "
                  "normal %2d  labels %2d of %d  features %d  unwritten %d",
                  pixels, colour_off, worst_colour, psnr_db(), alpha_off, depth_off,
                  worst_depth, normal_off, labels_off, labelled, features_off, poisoned);
    return line;
  }
};

/// Images that the reference lacks are not compared.
inline FrameDifference difference(const core::Frame& frame, const core::Frame& reference) {
  FrameDifference d;
  d.pixels = static_cast<int>(frame.alpha.size());
  for (std::size_t i = 0; i < frame.alpha.size(); ++i) {
    const float alpha = frame.alpha.pixels()[i], alpha_there = reference.alpha.pixels()[i];
    d.alpha_off += !(std::abs(alpha - alpha_there) <= 1e-3F) ? 1 : 0;
    // Bytes of 0xA5 as a float.
    d.poisoned += alpha < 0.0F ? 1 : 0;
    if (!reference.rgb.empty()) {
      const core::Rgb8 a = frame.rgb.pixels()[i], b = reference.rgb.pixels()[i];
      const int r = std::abs(a.r - b.r), g = std::abs(a.g - b.g), blue = std::abs(a.b - b.b);
      const int colour = std::max({r, g, blue});
      d.worst_colour = std::max(d.worst_colour, colour);
      d.colour_off += colour > 1 ? 1 : 0;
      d.squared_error += r * r + g * g + blue * blue;
    }
    // At alpha = 1/2 rounding decides whether there is a surface at all.
    const bool unclear = std::abs(alpha_there - 0.5F) <= 5e-3F;
    if (!reference.depth_m.empty()) {
      const float a = frame.depth_m.pixels()[i], b = reference.depth_m.pixels()[i];
      d.poisoned += a < 0.0F ? 1 : 0;
      if (std::isnan(a) != std::isnan(b)) {
        d.depth_off += unclear ? 0 : 1;
        continue;
      }
      if (!std::isnan(a)) {
        const double depth = static_cast<double>(std::abs(a - b) / b);
        d.worst_depth = std::max(d.worst_depth, depth);
        d.depth_off += depth > 1e-3 ? 1 : 0;
      }
    }
    if ((alpha >= 0.5F) != (alpha_there >= 0.5F)) continue;
    if (!reference.normal.empty()) {
      const float n = glm::length(frame.normal.pixels()[i] - reference.normal.pixels()[i]);
      d.normal_off += !(n <= 0.02F) ? 1 : 0;
    }
    if (!reference.semantic.empty()) {
      d.labelled += alpha >= 0.5F ? 1 : 0;
      const bool same = frame.semantic.pixels()[i] == reference.semantic.pixels()[i] &&
                        frame.instance.pixels()[i] == reference.instance.pixels()[i];
      d.labels_off += same ? 0 : 1;
      const float c = frame.confidence.pixels()[i] - reference.confidence.pixels()[i];
      const float n =
          frame.instance_confidence.pixels()[i] - reference.instance_confidence.pixels()[i];
      d.labels_off += same && !(std::abs(c) <= 0.02F && std::abs(n) <= 0.02F) ? 1 : 0;
    }
    if (!reference.semantic_feature.empty()) {
      float worst = 0.0F;
      for (std::size_t c = 0; c < 16; ++c) {
        worst = std::max(worst, std::abs(frame.semantic_feature.pixels()[i][c] -
                                         reference.semantic_feature.pixels()[i][c]));
      }
      for (std::size_t c = 0; c < 32; ++c) {
        worst = std::max(worst, std::abs(frame.instance_feature.pixels()[i][c] -
                                         reference.instance_feature.pixels()[i][c]));
      }
      d.features_off += !(worst <= 0.02F) ? 1 : 0;
    }
  }
  return d;
}

}  // namespace segsim::renderer::testing
