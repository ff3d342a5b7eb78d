#include "nav/mapping/depth_cleanup.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/check.h"

namespace segsim::nav {
namespace {

constexpr float kEmptyBelow = 0.1F;      // Inside the filter.
constexpr float kInvertAround = 100.0F;  // The filter's "maximum depth", made for metres.

cv::Mat square(int size) { return cv::getStructuringElement(cv::MORPH_RECT, {size, size}); }
cv::Mat cross(int size) { return cv::getStructuringElement(cv::MORPH_CROSS, {size, size}); }

/// Replaces the empty pixels of `image` by those of `other`.
void fill_empty(cv::Mat& image, const cv::Mat& other) {
  other.copyTo(image, image <= kEmptyBelow);
}

}  // namespace

core::Image<float> normalised_depth(const core::Image<float>& depth_m,
                                    const DepthCleanupOptions& options) {
  SEGSIM_CHECK(options.max_depth_m > options.min_depth_m, "depth range");
  const auto low = static_cast<float>(options.min_depth_m);
  const auto high = static_cast<float>(options.max_depth_m);
  core::Image<float> normalised(depth_m.width_px(), depth_m.height_px());
  std::transform(depth_m.pixels().begin(), depth_m.pixels().end(), normalised.pixels().begin(),
                 [&](float z) {
                   return z > 0.0F ? (std::clamp(z, low, high) - low) / (high - low) : 0.0F;
                 });
  return normalised;
}

core::Image<float> filled_depth(const core::Image<float>& normalised) {
  core::Image<float> result = normalised;
  if (normalised.empty()) return result;
  cv::Mat original(normalised.height_px(), normalised.width_px(), CV_32F, result.data());
  // Inverted, so that dilation prefers what is near.
  cv::Mat depth = original.clone();
  const cv::Mat valid = original > kEmptyBelow;
  cv::subtract(kInvertAround, depth, depth, valid);
  cv::dilate(depth, depth, cross(7));
  cv::morphologyEx(depth, depth, cv::MORPH_CLOSE, square(5));
  cv::Mat smooth;
  cv::medianBlur(depth, smooth, 5);
  smooth.copyTo(depth, depth > kEmptyBelow);

  // Larger gaps, below the first valid pixel of each column.
  cv::Mat below_top(depth.rows, depth.cols, CV_8U, cv::Scalar(255));
  for (int x = 0; x < depth.cols; ++x) {
    for (int y = 0; y < depth.rows && !(depth.at<float>(y, x) > kEmptyBelow); ++y) {
      below_top.at<std::uint8_t>(y, x) = 0;
    }
  }
  cv::Mat wide;
  cv::dilate(depth, wide, square(9));
  wide.copyTo(depth, (depth <= kEmptyBelow) & below_top);
  for (int pass = 0; pass < 6; ++pass) {
    cv::dilate(depth, wide, square(5));
    fill_empty(depth, wide);
  }
  cv::medianBlur(depth, smooth, 5);
  smooth.copyTo(depth, (depth > kEmptyBelow) & below_top);

  const cv::Mat filled = depth > kEmptyBelow;
  cv::subtract(kInvertAround, depth, depth, filled);
  depth.copyTo(original, original == 0.0F);
  cv::min(cv::max(original, 0.0F), 1.0F, original);
  return result;
}

void set_holes_far(core::Image<float>& normalised, const DepthCleanupOptions& options) {
  if (normalised.empty()) return;
  cv::Mat image(normalised.height_px(), normalised.width_px(), CV_32F, normalised.data());
  const cv::Mat empty = image == 0.0F;
  std::vector<std::vector<cv::Point>> outlines;
  cv::findContours(empty, outlines, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_SIMPLE);
  cv::Mat small(image.size(), CV_8U, cv::Scalar(0));
  for (std::size_t k = 0; k < outlines.size(); ++k) {
    if (cv::contourArea(outlines[k]) < options.hole_area_px2) {
      cv::drawContours(small, outlines, static_cast<int>(k), cv::Scalar(255), cv::FILLED);
    }
  }
  image.setTo(1.0F, small & empty);
}

void clean_depth_m(const core::Image<float>& depth_m, const VlfmRules& rules,
                   const DepthCleanupOptions& options, core::Image<float>& cleaned_m) {
  if (rules.published(Quirk::kZeroDepth)) {
    cleaned_m = filled_depth(normalised_depth(depth_m, options));
    set_holes_far(cleaned_m, options);
    const auto low = static_cast<float>(options.min_depth_m);
    const auto span = static_cast<float>(options.max_depth_m - options.min_depth_m);
    for (float& value : cleaned_m.pixels()) value = low + span * value;
    return;
  }
  cleaned_m.resize(depth_m.width_px(), depth_m.height_px());
  const auto far = static_cast<float>(options.max_depth_m);
  std::transform(depth_m.pixels().begin(), depth_m.pixels().end(), cleaned_m.pixels().begin(),
                 [far](float z) {
                   return z > 0.0F && z < far ? z : std::numeric_limits<float>::quiet_NaN();
                 });
}

double normalised_inferred(double depth_m, const VlfmRules& rules,
                           const DepthCleanupOptions& options) {
  const double clipped_m = std::clamp(depth_m, options.min_depth_m, options.max_depth_m);
  const double offset_m = rules.published(Quirk::kInferredOffset) ? 0.0 : options.min_depth_m;
  return (clipped_m - offset_m) / (options.max_depth_m - options.min_depth_m);
}

int thinning_of(const core::Image<float>& depth_m) {
  constexpr int kEnough_px = 320;
  return std::max(1, depth_m.width_px() / kEnough_px);
}

void thin_out(const core::Image<float>& depth_m, int n, core::Image<float>& thin_m) {
  thin_m.resize(depth_m.width_px() / n, depth_m.height_px() / n);
  for (int y = 0; y < thin_m.height_px(); ++y) {
    const float* from = depth_m.row(y * n);
    float* to = thin_m.row(y);
    for (int x = 0; x < thin_m.width_px(); ++x)
      to[x] = from[static_cast<std::ptrdiff_t>(x) * n];
  }
}

core::CameraIntrinsics thinned_camera(const core::CameraIntrinsics& camera, int n) {
  if (n == 1) return camera;
  // The centre of pixel n x is that of the new pixel x.
  return {camera.width_px / n, camera.height_px / n,           camera.fx_px / n,
          camera.fy_px / n,    (camera.cx_px - 0.5) / n + 0.5, (camera.cy_px - 0.5) / n + 0.5};
}

}  // namespace segsim::nav
