#include "perception/data/letterbox.h"

#include <algorithm>
#include <cmath>

namespace segsim::perception {

Letterbox Letterbox::fit(int image_width_px, int image_height_px, int width_px,
                         int height_px) {
  SEGSIM_CHECK(image_width_px > 0 && image_height_px > 0 && width_px > 0 && height_px > 0,
               "empty image");
  const double scale = std::min(static_cast<double>(width_px) / image_width_px,
                                static_cast<double>(height_px) / image_height_px);
  const auto scaled = [&](int side_px, int most_px) {
    return std::clamp(static_cast<int>(std::lround(side_px * scale)), 1, most_px);
  };
  const int width = scaled(image_width_px, width_px);
  const int height = scaled(image_height_px, height_px);
  return {width_px,
          height_px,
          image_width_px,
          image_height_px,
          (width_px - width) / 2,
          (height_px - height) / 2,
          static_cast<double>(width) / image_width_px,
          static_cast<double>(height) / image_height_px};
}

int Letterbox::scaled_width_px() const {
  return static_cast<int>(std::lround(scale_x * image_width_px));
}

int Letterbox::scaled_height_px() const {
  return static_cast<int>(std::lround(scale_y * image_height_px));
}

core::BoxPx Letterbox::to_square(const core::BoxPx& box) const {
  return {static_cast<float>(box.x0 * scale_x + offset_x_px),
          static_cast<float>(box.y0 * scale_y + offset_y_px),
          static_cast<float>(box.x1 * scale_x + offset_x_px),
          static_cast<float>(box.y1 * scale_y + offset_y_px)};
}

core::BoxPx Letterbox::to_image(const core::BoxPx& box) const {
  const auto back = [](float value, int offset, double scale, int limit) {
    return static_cast<float>(
        std::clamp((double{value} - offset) / scale, 0.0, static_cast<double>(limit)));
  };
  return {back(box.x0, offset_x_px, scale_x, image_width_px),
          back(box.y0, offset_y_px, scale_y, image_height_px),
          back(box.x1, offset_x_px, scale_x, image_width_px),
          back(box.y1, offset_y_px, scale_y, image_height_px)};
}

}  // namespace segsim::perception
