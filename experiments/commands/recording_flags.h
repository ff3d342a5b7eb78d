#pragma once

/// @file
/// Flags that say how a recording is to be read, where its layout does not say it.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "experiments/specs/rig_spec.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace CLI {  // NOLINT(readability-identifier-naming): theirs
class App;
}

namespace segsim::experiments::commands {

struct RecordingFlags {
  std::filesystem::path label_map;
  std::string layout = "auto", up = "auto", on_bad_frame = "refuse", sensor = "none";
  std::string color_depth, depth_time_offset, pose_time_offset;  ///< As given.
  std::vector<double> gravity;                                   ///< Three numbers, or none.
  double floor_height_m = 0.0, depth_scale = 1.0, pose_scale = 1.0, frame_rate_hz = 0.0;
  std::optional<double> read_out_ms;
  bool floor_given = false, invert_poses = false;
  bool poses_stated = false;  ///< A scale, or that poses are inverted, was given.

  /// Without rig(). @throws core::InputError for an unknown word.
  [[nodiscard]] reconstruction::SequenceOptions options() const;
  /// @throws core::InputError for an unknown word.
  [[nodiscard]] specs::RigSpec rig() const;
};

/// @param flags  Must outlive the command.
void add_recording_options(CLI::App& command, RecordingFlags& flags);

}  // namespace segsim::experiments::commands
