#include "perception/internal/assigner.h"

#include <algorithm>
#include <cmath>

#include "perception/internal/ciou.h"

namespace segsim::perception {
namespace {

struct Candidate {
  int anchor = 0;
  double overlap = 0.0;    ///< CIoU, > 0
  double alignment = 0.0;  ///< t
};

bool centre_inside(std::span<const float> centre_px, int anchor, const core::BoxPx& box) {
  const float x = centre_px[2 * anchor], y = centre_px[2 * anchor + 1];
  return x > box.x0 && x < box.x1 && y > box.y0 && y < box.y1;
}

/// Candidates with a positive alignment, the best first; of equals the lower anchor.
std::vector<Candidate> best_candidates(const AssignerInput& input, const LabeledBox& truth) {
  std::vector<Candidate> candidates;
  const int anchors = static_cast<int>(input.centre_px.size() / 2);
  for (int a = 0; a < anchors; ++a) {
    if (!centre_inside(input.centre_px, a, truth.box)) continue;
    const core::BoxPx predicted{input.boxes[4 * a], input.boxes[4 * a + 1],
                                input.boxes[4 * a + 2], input.boxes[4 * a + 3]};
    const double overlap = ciou(predicted, truth.box);
    const double score = input.scores[a * input.class_count + truth.class_index];
    if (overlap <= 0.0 || score <= 0.0) continue;
    candidates.push_back({a, overlap, std::sqrt(score) * std::pow(overlap, 6)});
  }
  std::stable_sort(
      candidates.begin(), candidates.end(),
      [](const Candidate& a, const Candidate& b) { return a.alignment > b.alignment; });
  if (candidates.size() > kCandidatesPerBox) candidates.resize(kCandidatesPerBox);
  return candidates;
}

void mask_ignored(const AssignerInput& input, const LabeledBox& ignored, Assignment& result) {
  for (std::size_t a = 0; a < result.box_of_anchor.size(); ++a) {
    if (!centre_inside(input.centre_px, static_cast<int>(a), ignored.box)) continue;
    const int owner = result.box_of_anchor[a];
    if (owner >= 0 && input.truth[owner].class_index == ignored.class_index) continue;
    result.class_weight[a * input.class_count + ignored.class_index] = 0;
  }
}

}  // namespace

Assignment assign_anchors(const AssignerInput& input) {
  const std::size_t anchors = input.centre_px.size() / 2;
  Assignment result;
  result.box_of_anchor.assign(anchors, -1);
  result.target_score.assign(anchors, 0.0F);
  result.class_weight.assign(anchors * input.class_count, 1);

  // Each box takes its best anchors; a contested one goes to the higher CIoU, the earlier box
  // if equal.
  std::vector<Candidate> owned(anchors);
  for (std::size_t b = 0; b < input.truth.size(); ++b) {
    if (input.truth[b].not_scored()) continue;
    for (const Candidate& candidate : best_candidates(input, input.truth[b])) {
      if (candidate.overlap <= owned[candidate.anchor].overlap) continue;
      owned[candidate.anchor] = candidate;
      result.box_of_anchor[candidate.anchor] = static_cast<int>(b);
    }
  }

  // Target scores, relative to the best anchor that each box has kept.
  std::vector<double> max_alignment(input.truth.size(), 0.0),
      max_overlap(input.truth.size(), 0.0);
  for (std::size_t a = 0; a < anchors; ++a) {
    const int b = result.box_of_anchor[a];
    if (b < 0) continue;
    max_alignment[b] = std::max(max_alignment[b], owned[a].alignment);
    max_overlap[b] = std::max(max_overlap[b], owned[a].overlap);
  }
  for (std::size_t a = 0; a < anchors; ++a) {
    const int b = result.box_of_anchor[a];
    if (b < 0 || max_alignment[b] <= 0.0) continue;
    result.target_score[a] =
        static_cast<float>(owned[a].alignment / max_alignment[b] * max_overlap[b]);
  }

  for (const LabeledBox& truth : input.truth) {
    if (truth.not_scored()) mask_ignored(input, truth, result);
  }
  return result;
}

}  // namespace segsim::perception
