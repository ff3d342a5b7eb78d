#pragma once

/// @file
/// Two trials beside each other as a part of a video.

#include <functional>
#include <string>

#include "experiments/films/run_video.h"
#include "experiments/video/video_file.h"

namespace segsim::experiments::films::internal {

/// Plays both and appends their screens at the same simulated times; whichever ends first
/// keeps its outcome in view. @param step_s  Simulated time from screen to screen.
void append_pair(TrialPlayer& player, const records::TrialRow& left,
                 const records::TrialRow& right, const std::string& title,
                 const std::string& note, double step_s, const std::function<void()>& on_tick,
                 video::internal::VideoFile& file);

}  // namespace segsim::experiments::films::internal
