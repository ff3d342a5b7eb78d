#include "reconstruction/datasets/internal/image_files.h"

#include <cstring>
#include <limits>
#include <string>

#include <opencv2/imgcodecs.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/pictures/picture_check.h"

namespace segsim::reconstruction::internal {
namespace {

using core::InputError;

cv::Mat decode(const std::filesystem::path& file, int flags) {
  cv::Mat image = cv::imread(file.string(), flags);
  if (image.empty()) {
    throw InputError::expected(file.string(), "a readable image", "data that does not decode");
  }
  return image;
}

}  // namespace

ImageSize check_image_file(const std::filesystem::path& file) {
  const core::PictureSize size = core::check_picture(core::read_file(file), file.string());
  return {size.width_px, size.height_px};
}

core::Image<core::Rgb8> read_color_image(const std::filesystem::path& file) {
  // The EXIF orientation is ignored: the intrinsics describe the stored pixels.
  const cv::Mat bgr = decode(file, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  core::Image<core::Rgb8> image(bgr.cols, bgr.rows);
  for (int y = 0; y < bgr.rows; ++y) {
    const auto* source = bgr.ptr<cv::Vec3b>(y);
    core::Rgb8* row = image.row(y);
    for (int x = 0; x < bgr.cols; ++x) row[x] = {source[x][2], source[x][1], source[x][0]};
  }
  return image;
}

core::Image<float> read_depth_image(const std::filesystem::path& file, double unit_m) {
  const cv::Mat raw = decode(file, cv::IMREAD_UNCHANGED);
  if (raw.type() != CV_16UC1) {
    throw InputError::expected(file.string(), "one 16-bit channel (depth)",
                               std::to_string(raw.channels()) + " channel(s) of " +
                                   std::to_string(8 * raw.elemSize1()) + " bit");
  }
  core::Image<float> image(raw.cols, raw.rows);
  for (int y = 0; y < raw.rows; ++y) {
    const auto* source = raw.ptr<std::uint16_t>(y);
    float* row = image.row(y);
    for (int x = 0; x < raw.cols; ++x) {
      const bool valid = source[x] != 0 && source[x] != 65535;
      row[x] = valid ? static_cast<float>(source[x]) * static_cast<float>(unit_m)
                     : std::numeric_limits<float>::quiet_NaN();
    }
  }
  return image;
}

core::Image<std::uint16_t> read_id_image(const std::filesystem::path& file) {
  cv::Mat raw = decode(file, cv::IMREAD_UNCHANGED);
  if (raw.type() == CV_8UC1) raw.convertTo(raw, CV_16U);
  if (raw.type() != CV_16UC1) {
    throw InputError::expected(file.string(), "one 8- or 16-bit channel (ids)",
                               std::to_string(raw.channels()) + " channel(s) of " +
                                   std::to_string(8 * raw.elemSize1()) + " bit");
  }
  core::Image<std::uint16_t> image(raw.cols, raw.rows);
  for (int y = 0; y < raw.rows; ++y) {
    std::memcpy(image.row(y), raw.ptr<std::uint16_t>(y),
                static_cast<std::size_t>(raw.cols) * sizeof(std::uint16_t));
  }
  return image;
}

}  // namespace segsim::reconstruction::internal
