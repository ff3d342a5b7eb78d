#include "reconstruction/inspection/inspect_recording.h"

#include <algorithm>
#include <iterator>

#include "reconstruction/inspection/camera_path.h"
#include "reconstruction/inspection/image_checks.h"
#include "reconstruction/inspection/pose_hypotheses.h"
#include "reconstruction/inspection/rig_checks.h"
#include "reconstruction/inspection/space_checks.h"
#include "reconstruction/inspection/view_directions.h"

namespace segsim::reconstruction {
namespace {

constexpr std::size_t kFewFrames = 30;

/// The loader's own complaints; of many only the first, for a folder may have thousands.
std::vector<Finding> loader_findings(const RgbdSequence& sequence) {
  constexpr std::size_t kMost = 6;
  std::vector<Finding> findings;
  for (const std::string& warning : sequence.warnings()) {
    // find_unseen_floor() says the same with what helps.
    if (warning.starts_with("no floor found")) continue;
    if (findings.size() == kMost) {
      findings.push_back(
          {FindingKind::kLoading,
           {},
           "and more: " + std::to_string(sequence.warnings().size()) + " complaints in all",
           {},
           false});
      break;
    }
    findings.push_back({FindingKind::kLoading, {}, warning, {}, false});
  }
  return findings;
}

std::vector<Finding> few_frames(const RgbdSequence& sequence) {
  if (sequence.frame_count() >= kFewFrames) return {};
  return {{FindingKind::kFewFrames,
           {},
           std::to_string(sequence.frame_count()) + " frames show a corner, not a place",
           "record a walk through all of it, several frames a second",
           false}};
}

}  // namespace

std::vector<Finding> inspect_recording(const RgbdSequence& sequence,
                                       const RecordingSample& sample) {
  std::vector<Finding> findings;
  const auto add = [&](std::vector<Finding> more) {
    std::move(more.begin(), more.end(), std::back_inserter(findings));
  };
  add(loader_findings(sequence));
  add(few_frames(sequence));
  add(find_repeated_frames(sequence));
  add(find_frame_gaps(sequence, sample));
  const std::vector<Finding> wrong_poses = find_wrong_poses(sequence, sample);
  add(wrong_poses);
  add(find_blur(sequence, sample));
  add(find_depth_holes(sequence, sample));
  add(find_depth_offset(sequence, sample, find_wrong_calibration(sequence, sample)));
  // With wrong poses, what these would find is that.
  if (wrong_poses.empty()) {
    add(find_late_poses(sequence));
    add(find_fast_camera(sequence, sample));
    add(find_unseen_directions(sequence, sample));
    add(find_unseen_floor(sample));
    add(find_open_loops(sequence, sample));
  }
  std::stable_partition(findings.begin(), findings.end(),
                        [](const Finding& finding) { return finding.defeats; });
  return findings;
}

std::vector<Finding> inspect_briefly(const RgbdSequence& sequence) {
  SampleOptions few;
  few.most_frames = 0;
  few.anchors = 12;
  few.edge_views = 0;
  std::vector<Finding> findings = find_wrong_poses(sequence, sample_recording(sequence, few));
  for (const Finding& finding : find_repeated_frames(sequence)) findings.push_back(finding);
  for (const Finding& finding : few_frames(sequence)) findings.push_back(finding);
  return findings;
}

}  // namespace segsim::reconstruction
