#include "perception/training/internal/augmentation.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/check.h"
#include "perception/data/letterbox.h"

namespace segsim::perception {
namespace {

// Ranges of Augmentation::tint.
constexpr double kMinGain = 0.7, kMaxGain = 1.4;      // All channels.
constexpr double kMinTint = 0.9, kMaxTint = 1.1;      // Each channel on its own.
constexpr double kMinColour = 0.6, kMaxColour = 1.4;  // Saturation.

/// A box with a side shorter than this is ignored.
constexpr float kMinSide_px = 2.0F;

cv::Mat view(const core::Image<core::Rgb8>& image) {
  // OpenCV wants writable memory for its header, also where it only reads.
  return {image.height_px(), image.width_px(), CV_8UC3, const_cast<core::Rgb8*>(image.data())};
}

/// Marks a box that was cut.
/// @param full_area_px2  Before cutting.
void judge_cut(LabeledBox& box, float full_area_px2, double min_kept_share) {
  box.ignore |= box.box.area_px2() < static_cast<float>(min_kept_share) * full_area_px2 ||
                box.box.width_px() < kMinSide_px || box.box.height_px() < kMinSide_px;
}

}  // namespace

core::BoxPx Warp::apply(const core::BoxPx& box) const {
  const double from = from_px / 2.0, to = to_px / 2.0;
  const auto x = [&](float v) { return scale * (v - from) + to + shift_x_px; };
  const auto cut = [&](double v) {
    return static_cast<float>(std::clamp(v, 0.0, double(to_px)));
  };
  const auto y = [&](float v) { return cut(scale * (v - from) + to + shift_y_px); };
  if (flip) return {cut(to_px - x(box.x1)), y(box.y0), cut(to_px - x(box.x0)), y(box.y1)};
  return {cut(x(box.x0)), y(box.y0), cut(x(box.x1)), y(box.y1)};
}

core::Image<core::Rgb8> Warp::apply(const core::Image<core::Rgb8>& image) const {
  SEGSIM_CHECK(image.width_px() == from_px && image.height_px() == from_px, "size");
  const double from = from_px / 2.0, to = to_px / 2.0;
  // Pixel i has its centre at i + 0.5 here and at i in OpenCV.
  double ax = scale, bx = scale * (0.5 - from) + to + shift_x_px - 0.5;
  const double by = scale * (0.5 - from) + to + shift_y_px - 0.5;
  if (flip) {
    ax = -ax;
    bx = to_px - 1.0 - bx;
  }
  const cv::Mat matrix = (cv::Mat_<double>(2, 3) << ax, 0.0, bx, 0.0, scale, by);
  core::Image<core::Rgb8> out(to_px, to_px);
  cv::Mat target = view(out);
  cv::warpAffine(view(image), target, matrix, target.size(), cv::INTER_LINEAR,
                 cv::BORDER_CONSTANT, cv::Scalar::all(kLetterboxGrey));
  return out;
}

Warp draw_warp(core::RandomStream& random, const Augmentation& augmentation, int from_px,
               int to_px) {
  Warp warp;
  warp.from_px = from_px;
  warp.to_px = to_px;
  warp.flip = random.chance(augmentation.flip);
  const double lo = augmentation.scale_min, hi = augmentation.scale_max;
  warp.scale = augmentation.log_scale ? std::exp(random.uniform(std::log(lo), std::log(hi)))
                                      : random.uniform(lo, hi);
  warp.shift_x_px = random.uniform(-augmentation.shift, augmentation.shift) * to_px;
  warp.shift_y_px = random.uniform(-augmentation.shift, augmentation.shift) * to_px;
  return warp;
}

Sample compose_mosaic(const std::array<const Sample*, 4>& samples, int x_px, int y_px,
                      double min_kept_share) {
  const int side = samples[0]->square.width_px(), canvas_px = 2 * side;
  SEGSIM_CHECK(
      2 * x_px >= side && 2 * x_px <= 3 * side && 2 * y_px >= side && 2 * y_px <= 3 * side,
      "centre of a mosaic");
  const auto limit = static_cast<float>(canvas_px);
  Sample mosaic{core::Image<core::Rgb8>(canvas_px, canvas_px,
                                        {kLetterboxGrey, kLetterboxGrey, kLetterboxGrey}),
                {},
                {0.0F, 0.0F, limit, limit}};
  cv::Mat canvas = view(mosaic.square);
  for (int quarter = 0; quarter < 4; ++quarter) {
    const Sample& sample = *samples[static_cast<std::size_t>(quarter)];
    const cv::Rect content(static_cast<int>(sample.content.x0),
                           static_cast<int>(sample.content.y0),
                           static_cast<int>(sample.content.width_px()),
                           static_cast<int>(sample.content.height_px()));
    const cv::Point corner(quarter % 2 == 0 ? x_px - content.width : x_px,
                           quarter < 2 ? y_px - content.height : y_px);
    const cv::Rect kept =
        cv::Rect(corner, content.size()) & cv::Rect(0, 0, canvas_px, canvas_px);
    const cv::Point shift = corner - content.tl();
    if (!kept.empty()) view(sample.square)(kept - shift).copyTo(canvas(kept));
    const auto dx = static_cast<float>(shift.x), dy = static_cast<float>(shift.y);
    for (LabeledBox box : sample.boxes) {
      const float full_area = box.box.area_px2();
      const auto cut = [limit](float v) { return std::clamp(v, 0.0F, limit); };
      box.box = {cut(box.box.x0 + dx), cut(box.box.y0 + dy), cut(box.box.x1 + dx),
                 cut(box.box.y1 + dy)};
      if (box.box.area_px2() <= 0.0F) continue;
      judge_cut(box, full_area, min_kept_share);
      mosaic.boxes.push_back(box);
    }
  }
  return mosaic;
}

std::vector<LabeledBox> warp_boxes(const std::vector<LabeledBox>& boxes, const Warp& warp,
                                   double min_kept_share) {
  std::vector<LabeledBox> warped;
  const auto scale_2 = static_cast<float>(warp.scale * warp.scale);
  for (LabeledBox box : boxes) {
    const float full_area = box.box.area_px2() * scale_2;
    box.box = warp.apply(box.box);
    if (box.box.area_px2() <= 0.0F) continue;
    judge_cut(box, full_area, min_kept_share);
    warped.push_back(box);
  }
  return warped;
}

void scale_hsv(core::Image<core::Rgb8>& image, double hue, double saturation, double value) {
  constexpr int kHues = 180;  // OpenCV's unit: two degrees.
  cv::Mat table(1, 256, CV_8UC3);
  for (int i = 0; i < 256; ++i) {
    table.at<cv::Vec3b>(i) = {static_cast<uchar>(std::fmod(i * hue, kHues)),
                              cv::saturate_cast<uchar>(i * saturation),
                              cv::saturate_cast<uchar>(i * value)};
  }
  cv::Mat pixels = view(image), hsv;
  cv::cvtColor(pixels, hsv, cv::COLOR_RGB2HSV);
  cv::LUT(hsv, table, hsv);
  cv::cvtColor(hsv, pixels, cv::COLOR_HSV2RGB);
}

void Colour::write_planes(const core::Image<core::Rgb8>& image, float* pixels) const {
  const std::size_t count = image.size();
  const core::Rgb8* source = image.data();
  float* r = pixels;
  float* g = pixels + count;
  float* b = pixels + 2 * count;
  const float kr = gain[0] / 255.0F, kg = gain[1] / 255.0F, kb = gain[2] / 255.0F;
  for (std::size_t i = 0; i < count; ++i) {
    const float vr = static_cast<float>(source[i].r) * kr;
    const float vg = static_cast<float>(source[i].g) * kg;
    const float vb = static_cast<float>(source[i].b) * kb;
    const float grey = 0.299F * vr + 0.587F * vg + 0.114F * vb;
    r[i] = std::clamp(grey + saturation * (vr - grey), 0.0F, 1.0F);
    g[i] = std::clamp(grey + saturation * (vg - grey), 0.0F, 1.0F);
    b[i] = std::clamp(grey + saturation * (vb - grey), 0.0F, 1.0F);
  }
}

Colour draw_colour(core::RandomStream& random) {
  Colour colour;
  const double gain = std::exp(random.uniform(std::log(kMinGain), std::log(kMaxGain)));
  for (float& channel : colour.gain) {
    channel = static_cast<float>(gain * random.uniform(kMinTint, kMaxTint));
  }
  colour.saturation = static_cast<float>(random.uniform(kMinColour, kMaxColour));
  return colour;
}

}  // namespace segsim::perception
