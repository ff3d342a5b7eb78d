#pragma once

/// @file
/// Where a camera was at any time, between the times at which its pose was measured.

#include <optional>
#include <vector>

#include "core/frames.h"

namespace segsim::reconstruction {

/// Poses with ascending times.
class PoseTrack {
 public:
  struct Entry {
    double time_s = 0.0;
    core::CameraPose T_world_camera;
  };

  PoseTrack() = default;
  /// @param entries  In any order; of those of one time the first is kept.
  explicit PoseTrack(std::vector<Entry> entries);

  [[nodiscard]] bool empty() const { return entries_.empty(); }
  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }

  /// Interpolated between the two entries around it: positions along a line, rotations along
  /// the shortest arc. Nothing before the first entry, after the last one, and inside gaps of
  /// more than kWidestGap_s.
  [[nodiscard]] std::optional<core::CameraPose> at(double time_s) const;

  /// Changes every pose.
  template <class Change>
  void for_each(const Change& change) {
    for (Entry& entry : entries_) change(entry.T_world_camera);
  }

  static constexpr double kWidestGap_s = 0.5;

 private:
  std::vector<Entry> entries_;
};

}  // namespace segsim::reconstruction
