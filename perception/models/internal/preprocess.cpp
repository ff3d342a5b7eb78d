#include "perception/models/internal/preprocess.h"

#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

#include "core/error.h"

namespace segsim::perception {
namespace {

Resampling pillow_taps(int input, int output, Kernel kernel) {
  ResampleRule rule;
  rule.kernel = kernel;
  rule.cubic_a = -0.5;
  rule.antialias = true;
  rule.scale = static_cast<double>(output) / input;
  rule.to_input = [scale = rule.scale](std::int64_t i) {
    return (static_cast<double>(i) + 0.5) / scale - 0.5;
  };
  return make_resampling(input, output, rule);
}

std::uint8_t to_byte(float value) {
  return static_cast<std::uint8_t>(std::clamp(std::floor(value + 0.5F), 0.0F, 255.0F));
}

/// One axis; `at(i, k)` is the pixel at place i of that axis and place k of the other.
template <class Read, class Write>
void resample_lines(const Resampling& taps, int outputs, int lines, const Read& at,
                    const Write& write) {
  for (int line = 0; line < lines; ++line) {
    for (int i = 0; i < outputs; ++i) {
      float sum[3] = {0, 0, 0};
      for (std::int64_t k = 0; k < taps.taps; ++k) {
        const auto tap = static_cast<std::size_t>(i * taps.taps + k);
        const core::Rgb8 pixel = at(static_cast<int>(taps.indices[tap]), line);
        const float weight = taps.weights[tap];
        sum[0] += weight * static_cast<float>(pixel.r);
        sum[1] += weight * static_cast<float>(pixel.g);
        sum[2] += weight * static_cast<float>(pixel.b);
      }
      write(i, line, core::Rgb8{to_byte(sum[0]), to_byte(sum[1]), to_byte(sum[2])});
    }
  }
}

}  // namespace

ColourImage resize_like_pillow(const ColourImage& image, int width_px, int height_px,
                               Kernel kernel) {
  SEGSIM_CHECK(!image.empty() && width_px > 0 && height_px > 0, "empty image");
  ColourImage rows = image;
  if (width_px != image.width_px()) {
    rows = ColourImage(width_px, image.height_px());
    resample_lines(
        pillow_taps(image.width_px(), width_px, kernel), width_px, image.height_px(),
        [&](int x, int y) { return image(x, y); },
        [&](int x, int y, core::Rgb8 pixel) { rows(x, y) = pixel; });
  }
  if (height_px == rows.height_px()) return rows;
  ColourImage result(width_px, height_px);
  resample_lines(
      pillow_taps(image.height_px(), height_px, kernel), height_px, width_px,
      [&](int y, int x) { return rows(x, y); },
      [&](int y, int x, core::Rgb8 pixel) { result(x, y) = pixel; });
  return result;
}

ColourImage resize_like_opencv(const ColourImage& image, int width_px, int height_px) {
  SEGSIM_CHECK(!image.empty() && width_px > 0 && height_px > 0, "empty image");
  ColourImage result(width_px, height_px);
  const cv::Mat source(image.height_px(), image.width_px(), CV_8UC3,
                       const_cast<core::Rgb8*>(image.data()));  // Only read.
  cv::Mat target(height_px, width_px, CV_8UC3, result.data());
  cv::resize(source, target, target.size(), 0.0, 0.0, cv::INTER_LINEAR);
  return result;
}

ColourImage centre_crop(const ColourImage& image, int side_px) {
  ColourImage result(side_px, side_px);
  const int left = (image.width_px() - side_px) / 2, top = (image.height_px() - side_px) / 2;
  for (int y = 0; y < side_px; ++y) {
    for (int x = 0; x < side_px; ++x) {
      if (image.contains(left + x, top + y)) result(x, y) = image(left + x, top + y);
    }
  }
  return result;
}

HostTensor to_planes(const ColourImage& image, int width_px, int height_px,
                     const Normalisation& normalisation) {
  const auto width = static_cast<std::size_t>(width_px);
  const std::size_t plane = width * static_cast<std::size_t>(height_px);
  std::vector<float> values(3 * plane, 0.0F);
  for (int y = 0; y < std::min(height_px, image.height_px()); ++y) {
    for (int x = 0; x < std::min(width_px, image.width_px()); ++x) {
      const core::Rgb8 pixel = image(x, y);
      const std::uint8_t channels[3] = {pixel.r, pixel.g, pixel.b};
      for (std::size_t c = 0; c < 3; ++c) {
        values[c * plane + static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)] =
            (static_cast<float>(channels[c]) / 255.0F - normalisation.mean[c]) /
            normalisation.deviation[c];
      }
    }
  }
  return {{1, 3, height_px, width_px}, std::move(values)};
}

const TensorInfo& image_input(const ModelSession& session, const std::string& place) {
  const TensorInfo* found = nullptr;
  bool clear = true;
  for (const TensorInfo& info : session.inputs()) {
    const bool planes = info.shape_known && info.shape.size() == 4 &&
                        (info.shape[1] == 3 || info.shape[1] == -1) && info.type != "int64";
    if (!planes && !(session.inputs().size() == 1 && !info.shape_known)) continue;
    clear = clear && found == nullptr;
    found = &info;
  }
  if (found != nullptr && clear) return *found;
  if (const TensorInfo* named = find_input(
          session, {"pixel_values", "images", "image", "img", "samples", "input_image"})) {
    return *named;
  }
  std::string signature;
  for (const TensorInfo& info : session.inputs()) {
    signature += (signature.empty() ? "" : ", ") + info.describe();
  }
  throw core::InputError::expected(place, "one image input [1, 3, height, width]", signature);
}

const TensorInfo* find_input(const ModelSession& session,
                             std::initializer_list<const char*> names) {
  for (const char* name : names) {
    for (const TensorInfo& info : session.inputs()) {
      if (info.name == name) return &info;
    }
  }
  return nullptr;
}

const HostTensor* find_output(const std::vector<ModelOutput>& outputs,
                              std::initializer_list<const char*> names) {
  for (const char* name : names) {
    for (const ModelOutput& output : outputs) {
      if (output.name == name) return &output.tensor;
    }
  }
  return nullptr;
}

int stated_side(const TensorInfo& info, std::size_t axis, int fallback) {
  constexpr std::int64_t kMost = 8192;
  if (!info.shape_known || axis >= info.shape.size()) return fallback;
  return info.shape[axis] > 0 && info.shape[axis] <= kMost ? static_cast<int>(info.shape[axis])
                                                           : fallback;
}

}  // namespace segsim::perception
