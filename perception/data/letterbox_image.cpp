#include <cmath>
#include <opencv2/imgproc.hpp>

#include "perception/data/letterbox.h"

namespace segsim::perception {

core::Image<core::Rgb8> letterbox(const core::Image<core::Rgb8>& image, const Letterbox& fit) {
  SEGSIM_CHECK(
      image.width_px() == fit.image_width_px && image.height_px() == fit.image_height_px,
      "image of another size");
  core::Image<core::Rgb8> square(fit.width_px, fit.height_px,
                                 {kLetterboxGrey, kLetterboxGrey, kLetterboxGrey});
  // OpenCV wants writable memory for its header; resize only reads the source.
  const cv::Mat source(image.height_px(), image.width_px(), CV_8UC3,
                       const_cast<core::Rgb8*>(image.data()));
  cv::Mat target = cv::Mat(fit.height_px, fit.width_px, CV_8UC3, square.data())(cv::Rect(
      fit.offset_x_px, fit.offset_y_px, fit.scaled_width_px(), fit.scaled_height_px()));
  const bool shrinks = fit.scale_x < 1.0 || fit.scale_y < 1.0;
  cv::resize(source, target, target.size(), 0.0, 0.0,
             shrinks ? cv::INTER_AREA : cv::INTER_LINEAR);
  return square;
}

}  // namespace segsim::perception
