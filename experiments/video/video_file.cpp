#include "experiments/video/video_file.h"

#include <cmath>
#include <fstream>
#include <string>
#include <system_error>
#include <utility>

#include <opencv2/imgproc.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/system/system_random.h"

namespace segsim::experiments::video::internal {
namespace {

namespace fs = std::filesystem;

}  // namespace

VideoFile::VideoFile(fs::path file, double frames_per_s)
    : file_(std::move(file)), frames_per_s_(frames_per_s) {
  SEGSIM_CHECK(frames_per_s > 0.0, file_.string());
  temporary_ = file_.parent_path() / ("." + file_.stem().string() + ".part" +
                                      core::unique_suffix() + file_.extension().string());
}

VideoFile::~VideoFile() {
  if (!writer_.isOpened()) return;
  writer_.release();
  std::error_code ignored;
  fs::remove(temporary_, ignored);
}

void VideoFile::open(const cv::Size& size) {
  std::error_code error;
  if (file_.has_parent_path()) fs::create_directories(file_.parent_path(), error);
  if (!std::ofstream(temporary_)) {
    throw core::InputError::expected(file_.string(), "a place for a video", "none");
  }
  for (const char* code : {"avc1", "mp4v", "MJPG"}) {
    const int fourcc = cv::VideoWriter::fourcc(code[0], code[1], code[2], code[3]);
    if (writer_.open(temporary_.string(), cv::CAP_FFMPEG, fourcc, frames_per_s_, size)) return;
  }
  fs::remove(temporary_, error);
  throw core::InputError::expected(file_.string(), "an encoder for a video", "none");
}

void VideoFile::write(const cv::Mat& page) {
  cv::Mat even = page;
  if (page.cols % 2 != 0 || page.rows % 2 != 0) {
    cv::copyMakeBorder(page, even, 0, page.rows % 2, 0, page.cols % 2, cv::BORDER_REPLICATE);
  }
  if (!writer_.isOpened()) open(even.size());
  SEGSIM_CHECK(last_.empty() || last_.size() == even.size(), "pages of one video");
  writer_.write(even);
  last_ = even.clone();
  ++frames_;
}

void VideoFile::hold(double duration_s) {
  SEGSIM_CHECK(!last_.empty(), file_.string());
  for (long k = std::lround(duration_s * frames_per_s_); k > 0; --k, ++frames_) {
    writer_.write(last_);
  }
}

void VideoFile::finish() {
  SEGSIM_CHECK(writer_.isOpened(), "a video has frames");
  writer_.release();
  std::error_code error;
  // The writer does not tell of a full disk; its file does.
  const cv::VideoCapture written(temporary_.string(), cv::CAP_FFMPEG);
  const int found = written.isOpened()
                        ? static_cast<int>(std::lround(written.get(cv::CAP_PROP_FRAME_COUNT)))
                        : 0;
  if (found != frames_) {
    fs::remove(temporary_, error);
    throw core::InputError::expected(file_.string(),
                                     "a video of " + std::to_string(frames_) + " frames",
                                     std::to_string(found) + " (is the disk full?)");
  }
  fs::rename(temporary_, file_, error);
  if (error) {
    const std::string why = error.message();
    fs::remove(temporary_, error);
    throw core::InputError::expected(file_.string(), "a place for a video", why);
  }
}

}  // namespace segsim::experiments::video::internal
