// Pictures of recordings, as colours, depths and ids (reconstruction/datasets/internal).
#include <opencv2/imgcodecs.hpp>

#include "core/error.h"
#include "reconstruction/datasets/internal/image_files.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/repair.h"

namespace segsim::fuzz {
namespace {

template <class Read>
bool reads(const Read& read) {
  try {
    (void)read();
    return true;
  } catch (const core::InputError&) {
    return false;
  }
}

std::string encoded(const char* format, const cv::Mat& image) {
  std::vector<unsigned char> bytes;
  cv::imencode(format, image, bytes);
  return {bytes.begin(), bytes.end()};
}

}  // namespace

void parse(const std::string& bytes) {
  namespace internal = reconstruction::internal;
  const std::filesystem::path file = in_file(with_png_checksums(bytes), "frame.png");
  const bool colours = reads([&] { return internal::read_color_image(file); });
  const bool depth = reads([&] { return internal::read_depth_image(file, 0.001); });
  const bool ids = reads([&] { return internal::read_id_image(file); });
  if (!colours && !depth && !ids) throw core::InputError("no picture of any kind");
}

std::vector<std::string> seeds() {
  return {encoded(".png", cv::Mat(3, 4, CV_8UC3, cv::Scalar(1, 2, 3))),
          encoded(".png", cv::Mat(3, 4, CV_16UC1, cv::Scalar(1500))),
          encoded(".jpg", cv::Mat(8, 16, CV_8UC3, cv::Scalar(200, 2, 3))),
          encoded(".jpg", cv::Mat(8, 8, CV_8UC1, cv::Scalar(90)))};
}

}  // namespace segsim::fuzz
