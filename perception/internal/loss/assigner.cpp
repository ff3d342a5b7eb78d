#include "perception/internal/loss/assigner.h"

#include <algorithm>
#include <cmath>

#include "perception/internal/loss/ciou.h"

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

/// How well an anchor's prediction fits a box whose centre area holds the anchor.
Candidate judge(const AssignerInput& input, const LabeledBox& truth, int anchor) {
  const float* box = input.boxes.data() + 4 * static_cast<std::size_t>(anchor);
  const double overlap = ciou({box[0], box[1], box[2], box[3]}, truth.box);
  const double score = input.scores[anchor * input.class_count + truth.class_index];
  if (overlap <= 0.0 || score <= 0.0) return {anchor, std::max(overlap, 0.0), 0.0};
  return {anchor, overlap, std::sqrt(score) * std::pow(overlap, 6)};
}

/// Candidates with a positive alignment, the best first; of equals the lower anchor.
std::vector<Candidate> best_candidates(const AssignerInput& input, const LabeledBox& truth) {
  std::vector<Candidate> candidates;
  const int anchors = static_cast<int>(input.centre_px.size() / 2);
  for (int a = 0; a < anchors; ++a) {
    if (!centre_inside(input.centre_px, a, truth.box)) continue;
    const Candidate candidate = judge(input, truth, a);
    if (candidate.alignment > 0.0) candidates.push_back(candidate);
  }
  std::stable_sort(
      candidates.begin(), candidates.end(),
      [](const Candidate& a, const Candidate& b) { return a.alignment > b.alignment; });
  if (candidates.size() > kCandidatesPerBox) candidates.resize(kCandidatesPerBox);
  return candidates;
}

/// The box of the highest CIoU of all around the anchor; the earlier box if equal.
int best_box_around(const AssignerInput& input, int anchor, Candidate& best) {
  int owner = -1;
  for (std::size_t b = 0; b < input.truth.size(); ++b) {
    const LabeledBox& truth = input.truth[b];
    if (truth.not_scored() || !centre_inside(input.centre_px, anchor, truth.box)) continue;
    const Candidate candidate = judge(input, truth, anchor);
    if (owner >= 0 && candidate.overlap <= best.overlap) continue;
    owner = static_cast<int>(b);
    best = candidate;
  }
  return owner;
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

Assignment assign_anchors(const AssignerInput& input, const AssignerRule& rule) {
  const std::size_t anchors = input.centre_px.size() / 2;
  Assignment result;
  result.box_of_anchor.assign(anchors, -1);
  result.target_score.assign(anchors, 0.0F);
  result.class_weight.assign(anchors * input.class_count, 1);

  // Each box takes its best anchors; a contested one goes to the higher CIoU, the earlier box
  // if equal.
  std::vector<Candidate> owned(anchors);
  std::vector<int> takers(anchors, 0);
  for (std::size_t b = 0; b < input.truth.size(); ++b) {
    if (input.truth[b].not_scored()) continue;
    for (const Candidate& candidate : best_candidates(input, input.truth[b])) {
      ++takers[candidate.anchor];
      if (candidate.overlap <= owned[candidate.anchor].overlap) continue;
      owned[candidate.anchor] = candidate;
      result.box_of_anchor[candidate.anchor] = static_cast<int>(b);
    }
  }
  for (std::size_t a = 0; rule.all_boxes_contest && a < anchors; ++a) {
    if (takers[a] < 2) continue;
    result.box_of_anchor[a] = best_box_around(input, static_cast<int>(a), owned[a]);
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
    result.target_score[a] = static_cast<float>(
        owned[a].alignment / (max_alignment[b] + rule.alignment_eps) * max_overlap[b]);
  }

  for (const LabeledBox& truth : input.truth) {
    if (truth.not_scored()) mask_ignored(input, truth, result);
  }
  return result;
}

}  // namespace segsim::perception
