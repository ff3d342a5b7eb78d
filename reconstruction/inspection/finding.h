#pragma once

/// @file
/// What is wrong with a recording, or will be hard about it, one line each.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace segsim::reconstruction {

class RgbdSequence;

enum class FindingKind : std::uint8_t {
  kLoading,  ///< What opening the recording complained about.
  kFewFrames,
  kInvertedPoses,
  kUnits,           ///< Of poses or of depth.
  kPosesDisagree,   ///< Depth does not fit the poses, whatever their unit and direction.
  kRepeatedFrames,  ///< Two frames of one time stamp or one name.
  kFrameGap,
  kFastCamera,
  kBlur,
  kUnseenDirections,
  kFloorUnseen,
  kCalibration,  ///< Of the colour camera against the depth camera.
  kClocks,       ///< Of pictures, depth and poses.
  kOpenLoop,
  kDepthHoles
};

struct Finding {
  FindingKind kind = FindingKind::kLoading;
  std::string where;    ///< Frames, or the whole recording.
  std::string how_bad;  ///< What was measured.
  std::string help;     ///< The flag or the action that helps.
  /// Nothing useful can be reconstructed before this is put right.
  bool defeats = false;
};

/// "motion blur", "open loop", ...
[[nodiscard]] std::string words_of(FindingKind kind);

/// "motion blur: frames 00012 to 00019 and 3 more: half as sharp ...; leave them out"
[[nodiscard]] std::string line_of(const Finding& finding);

/// "frame 00012", "frames 00012 to 00019", "frames 00003, 00012 to 00019 and 40 more": runs of
/// neighbours are drawn together, and at most four are named.
/// @param frames  Indices of the sequence, ascending.
[[nodiscard]] std::string frames_text(const RgbdSequence& sequence,
                                      const std::vector<std::size_t>& frames);

}  // namespace segsim::reconstruction
