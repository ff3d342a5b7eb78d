#include "reconstruction/inspection/image_detail.h"

#include <opencv2/imgproc.hpp>

#include "reconstruction/inspection/internal/grey_image.h"

namespace segsim::reconstruction {
namespace {

double laplacian_variance(const cv::Mat& grey) {
  cv::Mat laplacian;
  cv::Laplacian(grey, laplacian, CV_32F);
  cv::Scalar mean, deviation;
  cv::meanStdDev(laplacian, mean, deviation);
  return deviation[0] * deviation[0];
}

}  // namespace

ImageDetail measure_detail(const core::Image<core::Rgb8>& rgb) {
  const cv::Mat grey = internal::grey_image(rgb);
  cv::Mat coarse;
  cv::resize(grey, coarse, {}, 0.25, 0.25, cv::INTER_AREA);
  ImageDetail detail;
  detail.sharpness = laplacian_variance(grey);
  // One grey level squared is the noise that is there anyway.
  detail.fine_share = detail.sharpness / (laplacian_variance(coarse) + 1.0);
  return detail;
}

}  // namespace segsim::reconstruction
