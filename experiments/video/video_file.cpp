#include "experiments/video/video_file.h"

#include <cmath>
#include <string>
#include <system_error>
#include <utility>

#include <opencv2/imgproc.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/system/system_random.h"

namespace segsim::experiments::video::internal {

namespace fs = std::filesystem;

VideoFile::VideoFile(fs::path file, double frames_per_s)
    : file_(std::move(file)), frames_per_s_(frames_per_s) {
  SEGSIM_CHECK(frames_per_s > 0.0, file_.string());
  temporary_ = file_.parent_path() / ("." + file_.stem().string() + ".part" +
                                      core::unique_suffix() + file_.extension().string());
}

VideoFile::~VideoFile() {
  encoder_.reset();
  std::error_code ignored;
  fs::remove(temporary_, ignored);  // After finish() there is none of that name.
}

void VideoFile::write(const cv::Mat& page) {
  cv::Mat even = page;
  if (page.cols % 2 != 0 || page.rows % 2 != 0) {
    cv::copyMakeBorder(page, even, 0, page.rows % 2, 0, page.cols % 2, cv::BORDER_REPLICATE);
  }
  if (encoder_ == nullptr) {
    std::error_code ignored;
    if (file_.has_parent_path()) fs::create_directories(file_.parent_path(), ignored);
    encoder_ = std::make_unique<VideoEncoder>(temporary_, file_, even.size(), frames_per_s_);
  }
  encoder_->write(even);
  last_ = even.clone();
  ++frames_;
}

void VideoFile::hold(double duration_s) {
  SEGSIM_CHECK(!last_.empty(), file_.string());
  for (long k = std::lround(duration_s * frames_per_s_); k > 0; --k, ++frames_) {
    encoder_->write(last_);
  }
}

void VideoFile::finish() {
  SEGSIM_CHECK(encoder_ != nullptr, "a video has frames");
  encoder_->finish();
  std::error_code error;
  fs::rename(temporary_, file_, error);
  if (error)
    throw core::InputError::expected(file_.string(), "a place for a video", error.message());
  encoder_.reset();
}

}  // namespace segsim::experiments::video::internal
