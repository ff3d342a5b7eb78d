#pragma once

/// @file
/// What the robot sees, how the scene is labelled there, and its map, side by side.

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "core/stages.h"
#include "experiments/drawing/trial_picture.h"

namespace segsim::experiments::video {

/// Writes one video, frame by frame. H.264 in MP4 where OpenCV can encode it, MPEG-4
/// otherwise; the file appears under its name when the video is complete.
class TrialVideo {
 public:
  /// @param scene  Must outlive the video.
  /// @param frames_per_s  Of the finished video.
  TrialVideo(std::filesystem::path file, const drawing::TrialScene& scene,
             std::vector<std::string> detector_classes, double frames_per_s);
  ~TrialVideo();
  TrialVideo(const TrialVideo&) = delete;
  TrialVideo& operator=(const TrialVideo&) = delete;

  /// @param frame  With RGB and labels. @param view  In Odom.
  void add(const sim::TickRecord& tick, const core::Frame& frame,
           std::span<const core::Detection> detections, const core::PolicyView& view);

  /// Shows the result for two seconds and closes the file. Without a tick there is no video.
  /// @throws core::InputError if the video could not be written.
  void finish(const sim::TrialResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::experiments::video
