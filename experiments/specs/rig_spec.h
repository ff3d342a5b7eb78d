#pragma once

/// @file
/// How the cameras and clocks of a recording belong together, where its layout does not say it
/// (docs/datasets.md): flags of `segsim reconstruct`, keys of a spec's `source:`.

#include <filesystem>
#include <optional>
#include <string>

#include "reconstruction/datasets/depth_sensor.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::experiments::specs {

/// An offset of clocks that is given, or is to be found in the recording.
struct OffsetSpec {
  bool estimate = false;
  std::optional<double> milliseconds;

  [[nodiscard]] std::optional<double> seconds() const;
};

struct RigSpec {
  bool estimate_color_depth = false;
  std::filesystem::path color_depth;  ///< A file; empty: depth is registered to colour.
  OffsetSpec depth_time, pose_time;
  std::optional<double> frame_rate_hz, read_out_ms;
  reconstruction::DepthSensor sensor = reconstruction::DepthSensor::kUnstated;

  [[nodiscard]] bool estimates() const {
    return estimate_color_depth || depth_time.estimate || pose_time.estimate;
  }
  /// All that is stated, in words; empty if nothing is.
  [[nodiscard]] std::string text() const;
  /// Sets what is stated and need not be found.
  /// @throws core::InputError for a broken file of color_depth.
  void apply_to(reconstruction::SequenceOptions& options) const;
};

inline constexpr double kLongestReadOut_ms = 200.0;

/// "estimate", or a number of milliseconds, at most 10 s.
/// @throws core::InputError for another word.
[[nodiscard]] OffsetSpec parse_offset(const std::string& word, const std::string& place);

}  // namespace segsim::experiments::specs
