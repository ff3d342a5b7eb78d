#pragma once

/// @file
/// A video file, frame by frame.

#include <filesystem>
#include <memory>

#include <opencv2/core.hpp>

#include "experiments/video/video_encoder.h"

namespace segsim::experiments::video::internal {

/// The file appears under its name when it is complete; without finish() nothing stays behind.
class VideoFile {
 public:
  VideoFile(std::filesystem::path file, double frames_per_s);
  ~VideoFile();
  VideoFile(const VideoFile&) = delete;
  VideoFile& operator=(const VideoFile&) = delete;

  /// @param page  8-bit BGR, of equal size each time; a row and a column are added where a
  /// side is odd, which encoders refuse.
  /// @throws core::InputError if there is no encoder, or no place (a full disk, for example).
  void write(const cv::Mat& page);
  /// The last page again. Not before the first.
  void hold(double duration_s);
  /// Closes the file and gives it its name.  @throws core::InputError if there is no place.
  void finish();

  [[nodiscard]] int frames() const { return frames_; }
  [[nodiscard]] double duration_s() const { return frames_ / frames_per_s_; }
  [[nodiscard]] double frames_per_s() const { return frames_per_s_; }
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }

 private:
  std::filesystem::path file_, temporary_;
  double frames_per_s_;
  std::unique_ptr<VideoEncoder> encoder_;
  cv::Mat last_;
  int frames_ = 0;
};

}  // namespace segsim::experiments::video::internal
