#include "reconstruction/inspection/finding.h"

#include "core/check.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction {

std::string words_of(FindingKind kind) {
  switch (kind) {
    case FindingKind::kLoading:
      return "loading";
    case FindingKind::kFewFrames:
      return "few frames";
    case FindingKind::kInvertedPoses:
      return "inverted poses";
    case FindingKind::kUnits:
      return "wrong unit";
    case FindingKind::kPosesDisagree:
      return "poses and depth disagree";
    case FindingKind::kRepeatedFrames:
      return "repeated frames";
    case FindingKind::kFrameGap:
      return "frame gap";
    case FindingKind::kFastCamera:
      return "fast camera";
    case FindingKind::kBlur:
      return "motion blur";
    case FindingKind::kUnseenDirections:
      return "directions not looked at";
    case FindingKind::kFloorUnseen:
      return "floor unseen";
    case FindingKind::kCalibration:
      return "calibration";
    case FindingKind::kOpenLoop:
      return "open loop";
    case FindingKind::kDepthHoles:
      return "holes in depth";
  }
  SEGSIM_CHECK(false, "unknown kind of finding");
  return {};
}

std::string line_of(const Finding& finding) {
  return words_of(finding.kind) + ": " + (finding.where.empty() ? "" : finding.where + ": ") +
         finding.how_bad + (finding.help.empty() ? "" : "; " + finding.help);
}

std::string frames_text(const RgbdSequence& sequence, const std::vector<std::size_t>& frames) {
  constexpr int kMostRuns = 4;
  std::string text = frames.size() == 1 ? "frame " : "frames ";
  int runs = 0;
  std::size_t named = 0;
  while (named < frames.size() && runs < kMostRuns) {
    std::size_t last = named;
    while (last + 1 < frames.size() && frames[last + 1] == frames[last] + 1) ++last;
    text += (runs++ > 0 ? ", " : "") + sequence.frame_name(frames[named]);
    if (last > named) text += " to " + sequence.frame_name(frames[last]);
    named = last + 1;
  }
  if (named < frames.size()) text += " and " + std::to_string(frames.size() - named) + " more";
  return text;
}

}  // namespace segsim::reconstruction
