#include "perception/data/image_file.h"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/file_io.h"

namespace segsim::perception {
namespace {

struct Size {
  std::int64_t width_px = 0, height_px = 0;
};

std::int64_t big_endian(const std::string& bytes, std::size_t at, std::size_t count) {
  std::int64_t value = 0;
  for (std::size_t i = at; i < at + count; ++i) {
    value = 256 * value + static_cast<unsigned char>(bytes[i]);
  }
  return value;
}

/// A marker without a length: it stands alone.
bool stands_alone(unsigned char marker) {
  return marker == 0x01 || (marker >= 0xD0 && marker <= 0xD8);
}

/// Of the first frame of a JPEG; 0 x 0 if there is none.
Size size_in_jpeg(const std::string& bytes) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
  // Segments: any number of fill bytes 0xFF, marker, length, content; the frame's has the
  // size.
  std::size_t at = 2;
  while (at + 9 <= bytes.size() && byte(at) == 0xFF) {
    const unsigned char marker = byte(at + 1);
    if (marker == 0xFF || stands_alone(marker)) {
      at += marker == 0xFF ? 1 : 2;
      continue;
    }
    const bool is_frame =
        marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (is_frame) return {big_endian(bytes, at + 7, 2), big_endian(bytes, at + 5, 2)};
    at += 2 + static_cast<std::size_t>(big_endian(bytes, at + 2, 2));
  }
  return {};
}

/// What a PNG's or JPEG's header says, before anything is decoded; 0 x 0 if it is neither.
Size size_in_header(const std::string& bytes) {
  constexpr std::size_t kPngHeader = 24;
  if (bytes.size() >= kPngHeader && bytes.compare(0, 8, "\x89PNG\r\n\x1A\n") == 0 &&
      bytes.compare(12, 4, "IHDR") == 0) {
    return {big_endian(bytes, 16, 4), big_endian(bytes, 20, 4)};
  }
  return bytes.compare(0, 2, "\xFF\xD8") == 0 ? size_in_jpeg(bytes) : Size{};
}

}  // namespace

core::Image<core::Rgb8> read_image(const std::filesystem::path& file) {
  const std::string bytes = core::read_file(file);
  const Size size = size_in_header(bytes);
  if (size.width_px <= 0 || size.height_px <= 0) {  // Other formats are not decoded at all.
    throw core::InputError::expected(file.string(), "a PNG or JPEG image", "another file");
  }
  if (size.width_px * size.height_px > kMaxImagePixels) {
    throw core::InputError::expected(
        file.string(), "at most " + std::to_string(kMaxImagePixels) + " pixels",
        std::to_string(size.width_px) + " x " + std::to_string(size.height_px));
  }
  const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8U,
                        const_cast<char*>(bytes.data()));
  const cv::Mat bgr = cv::imdecode(encoded, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  if (bgr.empty()) {
    throw core::InputError::expected(file.string(), "a PNG or JPEG image",
                                     "data that cannot be decoded");
  }
  core::Image<core::Rgb8> image(bgr.cols, bgr.rows);
  cv::Mat rgb(bgr.rows, bgr.cols, CV_8UC3, image.data());
  cv::cvtColor(bgr, rgb, cv::COLOR_BGR2RGB);
  return image;
}

void write_image(const std::filesystem::path& file, const core::Image<core::Rgb8>& image,
                 int jpeg_quality) {
  const cv::Mat rgb(image.height_px(), image.width_px(), CV_8UC3,
                    const_cast<core::Rgb8*>(image.data()));
  cv::Mat bgr;
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  std::vector<unsigned char> encoded;
  bool done = false;
  try {
    done = cv::imencode(file.extension().string(), bgr, encoded,
                        {cv::IMWRITE_JPEG_QUALITY, jpeg_quality});
  } catch (const cv::Exception&) {  // No encoder for the extension.
  }
  if (!done)
    throw core::InputError::expected(file.string(), "extension .png or .jpg", "another");
  core::write_file_atomically(file, [&encoded](std::ostream& out) {
    for (const unsigned char byte : encoded) out.put(static_cast<char>(byte));
  });
}

}  // namespace segsim::perception
