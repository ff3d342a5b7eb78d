#include "perception/data/image_file.h"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/input/bounds.h"
#include "core/pictures/picture_check.h"
#include "core/system/remakeable_file.h"

namespace segsim::perception {

core::Image<core::Rgb8> read_image(const std::filesystem::path& file) {
  const std::string bytes = core::read_file(file);
  static_cast<void>(core::check_picture(bytes, file.string()));  // No other format is decoded.
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
  core::write_remakeable_file(file, [&encoded](std::ostream& out) {
    for (const unsigned char byte : encoded) out.put(static_cast<char>(byte));
  });
}

}  // namespace segsim::perception
