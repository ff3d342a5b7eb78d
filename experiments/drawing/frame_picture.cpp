#include "experiments/drawing/frame_picture.h"

#include <algorithm>
#include <cmath>

namespace segsim::experiments::drawing {
namespace {

using core::Image;
using core::Rgb8;

std::uint8_t to_byte(double value) {
  return static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(value, 0.0, 1.0)));
}

Rgb8 from_hsv(double hue, double saturation, double value) {
  const auto channel = [&](double n) {
    const double k = std::fmod(n + hue * 6.0, 6.0);
    return value - value * saturation * std::clamp(std::min(k, 4.0 - k), 0.0, 1.0);
  };
  return {to_byte(channel(5.0)), to_byte(channel(3.0)), to_byte(channel(1.0))};
}

Rgb8 scaled(const Rgb8& color, double factor) {
  return {to_byte(color.r / 255.0 * factor), to_byte(color.g / 255.0 * factor),
          to_byte(color.b / 255.0 * factor)};
}

void paste(Image<Rgb8>& sheet, const Image<Rgb8>& part, int x0, int y0) {
  for (int y = 0; y < part.height_px(); ++y) {
    std::copy_n(part.row(y), part.width_px(), sheet.row(y0 + y) + x0);
  }
}

}  // namespace

Rgb8 id_color(std::uint16_t id) {
  if (id == 0) return {40, 40, 40};
  // The golden ratio spreads hues; saturation and value alternate against look-alikes.
  const double hue = std::fmod(0.61803398875 * id, 1.0);
  return from_hsv(hue, id % 3 == 0 ? 0.45 : 0.75, id % 2 == 0 ? 0.95 : 0.75);
}

Image<Rgb8> depth_picture(const Image<float>& depth_m, double max_m) {
  Image<Rgb8> picture(depth_m.width_px(), depth_m.height_px());
  for (std::size_t i = 0; i < depth_m.size(); ++i) {
    const double depth = depth_m.data()[i];
    if (!std::isfinite(depth)) continue;
    const double t = std::clamp(depth / max_m, 0.0, 1.0);
    picture.data()[i] = from_hsv(0.68 * t, 0.85, 1.0 - 0.45 * t);
  }
  return picture;
}

Image<Rgb8> panoptic_picture(const core::Frame& frame) {
  const int width = frame.semantic.width_px();
  const int height = frame.semantic.height_px();
  Image<Rgb8> picture(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const std::uint16_t instance = frame.instance(x, y);
      const Rgb8 color = id_color(frame.semantic(x, y));
      const bool border = (x + 1 < width && frame.instance(x + 1, y) != instance) ||
                          (y + 1 < height && frame.instance(x, y + 1) != instance);
      const double shade = instance == 0 ? 0.75 : 0.75 + 0.25 * ((instance * 7 % 4) / 3.0);
      picture(x, y) = border ? Rgb8{255, 255, 255} : scaled(color, shade);
    }
  }
  return picture;
}

Image<Rgb8> normal_picture(const Image<glm::vec3>& normal) {
  Image<Rgb8> picture(normal.width_px(), normal.height_px());
  for (std::size_t i = 0; i < normal.size(); ++i) {
    const glm::vec3& n = normal.data()[i];
    if (n == glm::vec3(0.0F)) continue;
    picture.data()[i] = {to_byte(0.5 + 0.5 * n.x), to_byte(0.5 + 0.5 * n.y),
                         to_byte(0.5 + 0.5 * n.z)};
  }
  return picture;
}

Image<Rgb8> frame_picture(const core::Frame& frame) {
  const int width = frame.rgb.width_px();
  const int height = frame.rgb.height_px();
  Image<Rgb8> sheet(2 * width, 2 * height);
  paste(sheet, frame.rgb, 0, 0);
  paste(sheet, depth_picture(frame.depth_m), width, 0);
  paste(sheet, normal_picture(frame.normal), 0, height);
  paste(sheet, panoptic_picture(frame), width, height);
  return sheet;
}

}  // namespace segsim::experiments::drawing
