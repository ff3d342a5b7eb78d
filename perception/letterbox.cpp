#include "perception/letterbox.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace segsim::perception {

Letterbox Letterbox::fit(int image_width_px, int image_height_px, int size_px) {
  SEGSIM_CHECK(image_width_px > 0 && image_height_px > 0 && size_px > 0, "empty image");
  const double scale =
      static_cast<double>(size_px) / std::max(image_width_px, image_height_px);
  const auto scaled = [&](int side_px) {
    return std::clamp(static_cast<int>(std::lround(side_px * scale)), 1, size_px);
  };
  const int width = scaled(image_width_px), height = scaled(image_height_px);
  return {size_px,
          image_width_px,
          image_height_px,
          (size_px - width) / 2,
          (size_px - height) / 2,
          static_cast<double>(width) / image_width_px,
          static_cast<double>(height) / image_height_px};
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

core::Image<core::Rgb8> letterbox(const core::Image<core::Rgb8>& image, const Letterbox& fit) {
  SEGSIM_CHECK(
      image.width_px() == fit.image_width_px && image.height_px() == fit.image_height_px,
      "image of another size");
  core::Image<core::Rgb8> square(fit.size_px, fit.size_px,
                                 {kLetterboxGrey, kLetterboxGrey, kLetterboxGrey});
  // OpenCV wants writable memory for its header; resize only reads the source.
  const cv::Mat source(image.height_px(), image.width_px(), CV_8UC3,
                       const_cast<core::Rgb8*>(image.data()));
  const int width = static_cast<int>(std::lround(fit.scale_x * fit.image_width_px));
  const int height = static_cast<int>(std::lround(fit.scale_y * fit.image_height_px));
  cv::Mat target = cv::Mat(fit.size_px, fit.size_px, CV_8UC3, square.data())(
      cv::Rect(fit.offset_x_px, fit.offset_y_px, width, height));
  const bool shrinks = fit.scale_x < 1.0 || fit.scale_y < 1.0;
  cv::resize(source, target, target.size(), 0.0, 0.0,
             shrinks ? cv::INTER_AREA : cv::INTER_LINEAR);
  return square;
}

}  // namespace segsim::perception
