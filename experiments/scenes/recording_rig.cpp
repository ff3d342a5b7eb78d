#include "experiments/scenes/recording_rig.h"

#include <cstdio>
#include <string>

#include "core/error.h"
#include "reconstruction/inspection/pose_time_fit.h"
#include "reconstruction/inspection/rig_fit.h"

namespace segsim::experiments::scenes {
namespace {

namespace fs = std::filesystem;
using core::InputError;
using reconstruction::SequenceOptions;

void expect_times(const reconstruction::RgbdSequence& sequence, const std::string& flag) {
  if (!sequence.pose_track().empty()) return;
  throw InputError::expected(flag,
                             "a recording with time stamps (layout tum), or --frame-rate HZ",
                             sequence.name() + ", which has none");
}

void find_pose_time(const fs::path& recording, SequenceOptions& options) {
  const auto sequence = open_sequence(recording, options);
  expect_times(*sequence, "--pose-time-offset");
  const reconstruction::PoseTimeFit fit = reconstruction::fit_pose_time(*sequence);
  if (!fit.doubt.empty()) {
    throw InputError::expected("--pose-time-offset estimate",
                               "a recording that tells the offset for sure",
                               fit.doubt + "; give it in milliseconds, or leave the flag out");
  }
  if (fit.is_off()) options.times.pose_offset_s = fit.offset_s;
  std::printf("%s%s\n", fit.text().c_str(), fit.is_off() ? "" : "; left as they are");
}

void find_depth(const fs::path& recording, SequenceOptions& options, const specs::RigSpec& rig,
                const fs::path& save) {
  reconstruction::RigFitOptions fitting;
  fitting.fit_place = rig.estimate_color_depth;
  fitting.fit_time = rig.depth_time.estimate;
  fitting.use_times = fitting.fit_time || options.times.depth_offset_s.has_value();
  fitting.start.depth_time_s = options.times.depth_offset_s.value_or(0.0);
  const std::string flag =
      std::string(fitting.fit_place ? "--color-depth" : "--depth-time-offset") + " estimate";
  SequenceOptions apart = options;  // Depth as it was measured, not yet brought to colour.
  apart.times.depth_offset_s.reset();
  const auto sequence = open_sequence(recording, apart);
  if (!sequence->has_depth()) {
    throw InputError::expected(flag, "a recording with depth", sequence->name());
  }
  if (fitting.use_times) expect_times(*sequence, "--depth-time-offset");
  const reconstruction::RigFit fit = reconstruction::fit_rig(*sequence, fitting);
  if (!fit.doubt.empty()) {
    throw InputError::expected(flag, "a recording that tells the offset for sure",
                               fit.doubt + "; give it by hand, or leave the flag out");
  }
  std::printf("%s%s\n", fit.text(fitting).c_str(),
              fit.is_off() ? "" : "; too little to matter: depth is left where it is");
  if (!fit.is_off()) return;
  if (fitting.fit_time) options.times.depth_offset_s = fit.offset.depth_time_s;
  if (!fitting.fit_place) return;
  options.color_depth = {fit.offset.T_color_depth, {}};
  if (save.empty()) return;
  write_color_depth(save, *options.color_depth);
  std::printf("%s: where the depth camera stands, for --color-depth\n", save.string().c_str());
}

}  // namespace

SequenceOptions with_rig(const fs::path& recording, SequenceOptions options,
                         const specs::RigSpec& rig, const fs::path& save) {
  rig.apply_to(options);
  if (rig.pose_time.estimate) find_pose_time(recording, options);
  if (rig.estimate_color_depth || rig.depth_time.estimate) {
    find_depth(recording, options, rig, save);
  }
  return options;
}

}  // namespace segsim::experiments::scenes
