#include <string_view>
#include <vector>

#include <opencv2/imgcodecs.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/pictures/picture_check.h"
#include "worlds/mesh/texture_reader.h"

namespace segsim::worlds {
namespace {

core::Image<core::Rgb8> from_opencv(const cv::Mat& bgr) {
  core::Image<core::Rgb8> image(bgr.cols, bgr.rows);
  for (int y = 0; y < bgr.rows; ++y) {
    const auto* row = bgr.ptr<cv::Vec3b>(y);
    for (int x = 0; x < bgr.cols; ++x) image(x, y) = {row[x][2], row[x][1], row[x][0]};
  }
  return image;
}

/// False for a PNG or JPEG that was cut short, which OpenCV would fill with grey. Of other
/// formats OpenCV tells.
bool is_whole(std::string_view bytes) {
  if (!core::is_png_or_jpeg(bytes)) return true;
  try {
    static_cast<void>(core::check_picture(bytes, "texture"));
    return true;
  } catch (const core::InputError&) {
    return false;  // As for every file that is no image, the importer warns with its name.
  }
}

class ImageTextures final : public TextureReader {
 public:
  [[nodiscard]] core::Image<core::Rgb8> from_file(
      const std::filesystem::path& file) const override {
    if (!is_whole(core::read_file(file))) return {};
    return from_opencv(cv::imread(file.string(), cv::IMREAD_COLOR));
  }
  [[nodiscard]] core::Image<core::Rgb8> from_bytes(
      std::span<const unsigned char> bytes) const override {
    const std::vector<unsigned char> copy(bytes.begin(), bytes.end());
    if (!is_whole({reinterpret_cast<const char*>(copy.data()), copy.size()})) return {};
    return from_opencv(cv::imdecode(copy, cv::IMREAD_COLOR));
  }
};

}  // namespace

const TextureReader& image_textures() {
  static const ImageTextures reader;
  return reader;
}

}  // namespace segsim::worlds
