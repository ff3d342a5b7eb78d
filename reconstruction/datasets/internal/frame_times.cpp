#include "reconstruction/datasets/internal/frame_times.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <utility>

#include "core/error.h"

namespace segsim::reconstruction::internal {
namespace {

using core::InputError;

constexpr double kFarthest_s = 0.1;

void number_times(SequenceParts& parts, double rate_hz) {
  for (FrameFiles& frame : parts.frames) {
    if (frame.time_s) {
      throw InputError::expected("--frame-rate", "a recording without time stamps",
                                 parts.name + ", which has some");
    }
    const auto number = frame_number(frame.name);
    if (!number) {
      throw InputError::expected("--frame-rate", "frames with a number in their names",
                                 frame.name);
    }
    frame.time_s = frame.depth_time_s = static_cast<double>(*number) / rate_hz;
  }
}

bool all_timed(const SequenceParts& parts) {
  return std::all_of(parts.frames.begin(), parts.frames.end(),
                     [](const FrameFiles& frame) { return frame.time_s.has_value(); });
}

struct DepthFile {
  std::filesystem::path png, exr;
  double stamp_s = 0.0;
};

/// By time; of one file that several frames name, one.
using DepthFiles = std::map<double, DepthFile>;

DepthFiles depth_files(const SequenceParts& parts, double offset_s) {
  DepthFiles files;
  for (const FrameFiles& frame : parts.frames) {
    if (!frame.depth_time_s) continue;
    files.try_emplace(*frame.depth_time_s + offset_s,
                      DepthFile{frame.depth_png, frame.depth_exr, *frame.depth_time_s});
  }
  return files;
}

/// The file measured nearest to a time; end() if none is near.
DepthFiles::const_iterator nearest(const DepthFiles& files, double time_s) {
  auto best = files.lower_bound(time_s);
  if (best == files.end() ||
      (best != files.begin() && time_s - std::prev(best)->first <= best->first - time_s)) {
    if (best == files.begin()) return files.end();
    --best;
  }
  return std::abs(best->first - time_s) <= kFarthest_s ? best : files.end();
}

std::string milliseconds(double time_s) {
  std::ostringstream text;
  text << 1e3 * time_s << " ms";
  return text.str();
}

}  // namespace

void apply_times(SequenceParts& parts, const TimeOptions& options) {
  if (options.frame_rate_hz) number_times(parts, *options.frame_rate_hz);
  const bool timed = all_timed(parts);
  if (timed && parts.track.empty()) {
    std::vector<PoseTrack::Entry> entries;
    for (const FrameFiles& frame : parts.frames) {
      entries.push_back({*frame.time_s, frame.T_world_camera});
    }
    parts.track = PoseTrack(std::move(entries));
  }
  if (!options.shifts()) return;
  if (!timed || parts.track.empty()) {
    throw InputError::expected(options.depth_offset_s  ? "--depth-time-offset"
                               : options.pose_offset_s ? "--pose-time-offset"
                                                       : "--rolling-shutter",
                               "a recording with time stamps (layout tum), or --frame-rate HZ",
                               parts.name + ", which has none");
  }
  const double pose_offset_s = options.pose_offset_s.value_or(0.0);
  const double depth_offset_s = options.depth_offset_s.value_or(0.0);
  const DepthFiles files = depth_files(parts, depth_offset_s);
  const std::size_t before = parts.frames.size();
  std::erase_if(parts.frames, [&](FrameFiles& frame) {
    const auto T_world_color = parts.track.at(*frame.time_s - pose_offset_s);
    if (!T_world_color) return true;
    for (const double half_s : {-0.5, 0.5}) {
      if (!parts.track.at(*frame.time_s - pose_offset_s +
                          half_s * options.read_out_s.value_or(0.0))) {
        return true;
      }
    }
    frame.T_world_camera = *T_world_color;
    if (!options.depth_offset_s || !frame.depth_time_s) return false;
    const auto depth = nearest(files, *frame.time_s);
    if (depth == files.end()) return true;
    const auto T_world_then = parts.track.at(depth->first - pose_offset_s);
    if (!T_world_then) return true;
    frame.depth_png = depth->second.png, frame.depth_exr = depth->second.exr;
    frame.depth_time_s = depth->second.stamp_s;
    frame.T_color_moved = T_world_color->inverse() * *T_world_then;
    return false;
  });
  if (parts.frames.empty()) {
    throw InputError::expected(parts.name, "frames with pose and depth at their times",
                               "none: are the offsets in milliseconds?");
  }
  parts.times = options;
  if (options.read_out_s) {
    parts.notes.push_back("rolling shutter of " + milliseconds(*options.read_out_s) +
                          ": pictures straightened");
  }
  if (options.depth_offset_s) {
    parts.notes.push_back("depth images measured " + milliseconds(depth_offset_s) +
                          " after their stamps; the camera's motion is allowed for");
  }
  if (options.pose_offset_s) {
    parts.notes.push_back("poses are of " + milliseconds(pose_offset_s) +
                          " after their stamps; interpolated");
  }
  if (parts.frames.size() < before) {
    parts.notes.push_back(std::to_string(before - parts.frames.size()) +
                          " frames without pose or depth at their time left out");
  }
}

}  // namespace segsim::reconstruction::internal
