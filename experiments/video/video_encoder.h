#pragma once

/// @file
/// Pictures to a video by FFmpeg's libraries. OpenCV's writer uses them, too, but leaves
/// x264 at a setting that takes four times as long for files of the same size.

#include <filesystem>
#include <memory>

#include <opencv2/core.hpp>

namespace segsim::experiments::video::internal {

class VideoEncoder {
 public:
  /// H.264 where there is x264 (browsers play that), MPEG-4 otherwise.
  /// @param shown_as  The name that errors tell.  @param size  Both sides even.
  /// @throws core::InputError if there is no place for the file.
  VideoEncoder(const std::filesystem::path& file, const std::filesystem::path& shown_as,
               const cv::Size& size, double frames_per_s);
  ~VideoEncoder();
  VideoEncoder(const VideoEncoder&) = delete;
  VideoEncoder& operator=(const VideoEncoder&) = delete;

  /// @param page  8-bit BGR of the given size.  @throws core::InputError if the disk is full.
  void write(const cv::Mat& page);
  /// Writes what is held back and the file's index; once, after which the file is whole.
  /// @throws core::InputError if the disk is full.
  void finish();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace segsim::experiments::video::internal
