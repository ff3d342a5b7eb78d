#include "reconstruction/datasets/internal/image_files.h"

#include <array>
#include <cstring>
#include <limits>
#include <string>
#include <string_view>

#include <opencv2/imgcodecs.hpp>

#include "core/error.h"
#include "core/file_io.h"

namespace segsim::reconstruction::internal {
namespace {

using core::InputError;

constexpr std::string_view kPngSignature{"\x89PNG\r\n\x1a\n", 8};
constexpr std::string_view kJpegStart{"\xff\xd8", 2};

std::uint32_t big_endian(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < count; ++i) {
    value = (value << 8U) | static_cast<unsigned char>(bytes[at + i]);
  }
  return value;
}

/// CRC-32 of the PNG specification (annex D).
std::uint32_t crc32(std::string_view bytes) {
  static const std::array<std::uint32_t, 256> table = [] {
    std::array<std::uint32_t, 256> entries{};
    for (std::uint32_t n = 0; n < 256; ++n) {
      std::uint32_t c = n;
      for (int bit = 0; bit < 8; ++bit) c = (c & 1U) != 0U ? 0xEDB88320U ^ (c >> 1U) : c >> 1U;
      entries[n] = c;
    }
    return entries;
  }();
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const char byte : bytes) {
    crc = table[(crc ^ static_cast<unsigned char>(byte)) & 0xFFU] ^ (crc >> 8U);
  }
  return crc ^ 0xFFFFFFFFU;
}

std::string at_byte(std::size_t at, std::size_t size) {
  return "the end of the file at byte " + std::to_string(size) + " (read up to byte " +
         std::to_string(at) + ")";
}

ImageSize check_png(std::string_view bytes, const std::string& place) {
  ImageSize size;
  std::size_t at = kPngSignature.size();
  while (true) {
    if (bytes.size() < at + 12) {
      throw InputError::expected(place, "a complete PNG file (IEND chunk)",
                                 at_byte(at, bytes.size()));
    }
    const std::size_t length = big_endian(bytes, at, 4);
    const std::string_view type = bytes.substr(at + 4, 4);
    if (bytes.size() - at - 12 < length) {
      throw InputError::expected(place, "a complete PNG file (IEND chunk)",
                                 at_byte(at, bytes.size()));
    }
    if (crc32(bytes.substr(at + 4, length + 4)) != big_endian(bytes, at + 8 + length, 4)) {
      throw InputError::expected(
          place, "intact PNG data",
          "a wrong checksum in the chunk at byte " + std::to_string(at));
    }
    if (type == "IHDR" && length >= 8) {
      size.width_px = static_cast<int>(big_endian(bytes, at + 8, 4));
      size.height_px = static_cast<int>(big_endian(bytes, at + 12, 4));
    }
    if (type == "IEND") return size;
    at += length + 12;
  }
}

/// Frame headers carry the size: SOF0 ... SOF15 without DHT (C4), JPG (C8) and DAC (CC).
bool is_jpeg_frame_header(unsigned marker) {
  return marker >= 0xC0U && marker <= 0xCFU && marker != 0xC4U && marker != 0xC8U &&
         marker != 0xCCU;
}

ImageSize check_jpeg(std::string_view bytes, const std::string& place) {
  ImageSize size;
  std::size_t at = 2;
  while (at + 4 <= bytes.size() && static_cast<unsigned char>(bytes[at]) == 0xFFU) {
    const unsigned marker = static_cast<unsigned char>(bytes[at + 1]);
    const std::size_t length = big_endian(bytes, at + 2, 2);
    if (is_jpeg_frame_header(marker) && at + 9 <= bytes.size()) {
      size.height_px = static_cast<int>(big_endian(bytes, at + 5, 2));
      size.width_px = static_cast<int>(big_endian(bytes, at + 7, 2));
    }
    if (marker == 0xDAU) break;  // Start of scan: entropy-coded data up to the end marker.
    at += 2 + length;
  }
  // Some cameras append zeros behind the end marker.
  std::size_t end = bytes.size();
  while (end > 0 && bytes[end - 1] == '\0') --end;
  if (size.width_px <= 0 || end < 2 ||
      bytes.substr(end - 2, 2) != std::string_view("\xff\xd9", 2)) {
    throw InputError::expected(place, "a complete JPEG file (end marker FFD9)",
                               at_byte(bytes.size(), bytes.size()));
  }
  return size;
}

cv::Mat decode(const std::filesystem::path& file, int flags) {
  cv::Mat image = cv::imread(file.string(), flags);
  if (image.empty()) {
    throw InputError::expected(file.string(), "a readable image", "data that does not decode");
  }
  return image;
}

}  // namespace

ImageSize check_image_file(const std::filesystem::path& file) {
  const std::string bytes = core::read_file(file);
  const std::string_view view = bytes;
  ImageSize size;
  if (view.starts_with(kPngSignature)) {
    size = check_png(view, file.string());
  } else if (view.starts_with(kJpegStart)) {
    size = check_jpeg(view, file.string());
  } else {
    throw InputError::expected(file.string(), "a PNG or JPEG file",
                               bytes.empty() ? "an empty file" : "another format");
  }
  if (size.width_px <= 0 || size.height_px <= 0) {
    throw InputError::expected(
        file.string(), "an image size > 0",
        std::to_string(size.width_px) + "x" + std::to_string(size.height_px));
  }
  return size;
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
