#include "perception/internal/loss/assigner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "core/random.h"
#include "perception/internal/loss/ciou.h"

namespace segsim::perception {
namespace {

using core::BoxPx;

constexpr int kCells = 8, kClasses = 3;
constexpr float kCell_px = 8.0F;

/// A grid of anchors with given predictions.
struct Scene {
  std::vector<float> centres, scores, boxes;
  std::vector<LabeledBox> truth;

  Scene() {
    for (int y = 0; y < kCells; ++y) {
      for (int x = 0; x < kCells; ++x) {
        centres.push_back((static_cast<float>(x) + 0.5F) * kCell_px);
        centres.push_back((static_cast<float>(y) + 0.5F) * kCell_px);
      }
    }
    scores.assign(kCells * kCells * kClasses, 0.1F);
    for (std::size_t a = 0; a < centres.size() / 2; ++a) {
      const float x = centres[2 * a], y = centres[2 * a + 1];
      boxes.insert(boxes.end(), {x - 10, y - 10, x + 10, y + 10});
    }
  }
  void add(int class_index, BoxPx box, bool ignore = false) {
    LabeledBox label;
    label.class_index = class_index;
    label.box = box;
    label.ignore = ignore;
    truth.push_back(label);
  }
  [[nodiscard]] AssignerInput input() const {
    return {kClasses, centres, scores, boxes, truth};
  }
  [[nodiscard]] BoxPx predicted(std::size_t a) const {
    return {boxes[4 * a], boxes[4 * a + 1], boxes[4 * a + 2], boxes[4 * a + 3]};
  }
};

/// The definition, matrix by matrix: rank of each anchor for each box by counting better ones.
Assignment slow_twin(const Scene& s, const AssignerRule& rule = {}) {
  const std::size_t anchors = s.centres.size() / 2, boxes = s.truth.size();
  std::vector<std::vector<double>> t(boxes, std::vector<double>(anchors, 0.0)), overlap = t;
  for (std::size_t b = 0; b < boxes; ++b) {
    if (s.truth[b].not_scored()) continue;
    const BoxPx& g = s.truth[b].box;
    for (std::size_t a = 0; a < anchors; ++a) {
      const float x = s.centres[2 * a], y = s.centres[2 * a + 1];
      if (x <= g.x0 || x >= g.x1 || y <= g.y0 || y >= g.y1) continue;
      overlap[b][a] = std::max(0.0, ciou(s.predicted(a), g));
      const double score = s.scores[a * kClasses + s.truth[b].class_index];
      t[b][a] = std::pow(score, 0.5) * std::pow(overlap[b][a], 6.0);
    }
  }
  Assignment result{std::vector<int>(anchors, -1), std::vector<float>(anchors, 0.0F),
                    std::vector<std::uint8_t>(anchors * kClasses, 1)};
  for (std::size_t a = 0; a < anchors; ++a) {
    int takers = 0;
    std::size_t best = 0;
    for (std::size_t b = 0; b < boxes; ++b) {
      if (overlap[b][a] > overlap[best][a]) best = b;
      int better = 0;
      for (std::size_t other = 0; other < anchors; ++other) {
        better += t[b][other] > t[b][a] || (t[b][other] == t[b][a] && other < a) ? 1 : 0;
      }
      if (t[b][a] <= 0.0 || better >= kCandidatesPerBox) continue;
      ++takers;
      const int now = result.box_of_anchor[a];
      if (now < 0 || overlap[b][a] > overlap[now][a])
        result.box_of_anchor[a] = static_cast<int>(b);
    }
    if (rule.all_boxes_contest && takers > 1) result.box_of_anchor[a] = static_cast<int>(best);
  }
  for (std::size_t a = 0; a < anchors; ++a) {
    const int b = result.box_of_anchor[a];
    if (b < 0) continue;
    double max_t = 0.0, max_overlap = 0.0;
    for (std::size_t other = 0; other < anchors; ++other) {
      if (result.box_of_anchor[other] != b) continue;
      max_t = std::max(max_t, t[b][other]);
      max_overlap = std::max(max_overlap, overlap[b][other]);
    }
    result.target_score[a] =
        static_cast<float>(t[b][a] / (max_t + rule.alignment_eps) * max_overlap);
  }
  return result;
}

TEST(Ciou, AgreesWithHandComputedValues) {
  // Equal boxes: 1. Disjoint 2x2 boxes, 4 apart along x: IoU 0, rho^2 = 16, c^2 = 36 + 4.
  EXPECT_NEAR(ciou({0, 0, 4, 2}, {0, 0, 4, 2}), 1.0, 1e-6);
  EXPECT_NEAR(ciou({0, 0, 2, 2}, {4, 0, 6, 2}), -16.0 / 40.0, 1e-6);
  // Half overlap, equal centres: IoU = 8 / 16; v = 4/pi^2 (atan(4/4) - atan(4/2))^2.
  const double angle = std::atan(1.0) - std::atan(2.0);
  const double v = 4.0 / (M_PI * M_PI) * angle * angle;
  EXPECT_NEAR(ciou({0, 0, 4, 4}, {0, 1, 4, 3}), 0.5 - v * v / (v - 0.5 + 1.0), 1e-6);
}

TEST(Assigner, AgreesWithSlowTwinOnRandomScenes) {
  int positives = 0, differ_by_rule = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    core::RandomStream random(seed, "assigner");
    Scene s;
    for (float& score : s.scores) score = static_cast<float>(random.uniform(0.001, 0.9));
    for (float& corner : s.boxes) corner += static_cast<float>(random.uniform(-8, 8));
    const auto count = random.index(14);
    for (std::uint32_t i = 0; i < count; ++i) {
      const auto x = static_cast<float>(random.uniform(0, 50));
      const auto y = static_cast<float>(random.uniform(0, 50));
      s.add(static_cast<int>(random.index(kClasses)),
            {x, y, x + static_cast<float>(random.uniform(2, 40)),
             y + static_cast<float>(random.uniform(2, 40))});
    }
    const Assignment fast = assign_anchors(s.input());
    for (const AssignerRule& rule : {AssignerRule{}, AssignerRule{1e-3, true}}) {
      const Assignment found = assign_anchors(s.input(), rule), slow = slow_twin(s, rule);
      ASSERT_EQ(found.box_of_anchor, slow.box_of_anchor) << seed;
      for (std::size_t a = 0; a < found.target_score.size(); ++a) {
        ASSERT_NEAR(found.target_score[a], slow.target_score[a], 1e-6);
      }
      differ_by_rule += found.box_of_anchor != fast.box_of_anchor ? 1 : 0;
    }
    positives += static_cast<int>(std::count_if(
        fast.box_of_anchor.begin(), fast.box_of_anchor.end(), [](int b) { return b >= 0; }));
  }
  EXPECT_GT(positives, 500);
  EXPECT_GT(differ_by_rule, 0);
}

TEST(Assigner, EmptyImageIsAllBackground) {
  const Scene s;
  const Assignment result = assign_anchors(s.input());
  for (const int owner : result.box_of_anchor) EXPECT_EQ(owner, -1);
  for (const auto weight : result.class_weight) EXPECT_EQ(weight, 1);
}

TEST(Assigner, BoxWithoutAnchorCentreGetsNone) {
  Scene s;
  s.add(0, {5, 5, 11, 11});  // Centres lie at 4 and 12.
  for (const int owner : assign_anchors(s.input()).box_of_anchor) EXPECT_EQ(owner, -1);
}

TEST(Assigner, OfTwoIdenticalBoxesTheFirstTakesAll) {
  Scene s;
  s.add(1, {10, 10, 40, 40});
  s.add(1, {10, 10, 40, 40});
  std::map<int, int> count;
  for (const int owner : assign_anchors(s.input()).box_of_anchor) ++count[owner];
  EXPECT_GT(count[0], 0);
  EXPECT_EQ(count[1], 0);
}

TEST(Assigner, BoxTakesAtMostTenAnchorsAndBestTargetIsItsBestOverlap) {
  Scene s;
  s.add(2, {0, 0, 64, 64});
  const Assignment result = assign_anchors(s.input());
  EXPECT_EQ(std::count(result.box_of_anchor.begin(), result.box_of_anchor.end(), 0), 10);
  double best = 0.0;
  for (std::size_t a = 0; a < result.box_of_anchor.size(); ++a) {
    if (result.box_of_anchor[a] == 0)
      best = std::max(best, ciou(s.predicted(a), s.truth[0].box));
  }
  EXPECT_NEAR(*std::max_element(result.target_score.begin(), result.target_score.end()), best,
              1e-6);
}

TEST(Assigner, IgnoredBoxMasksItsClassOnly) {
  Scene s;
  s.add(1, {0, 0, 16, 16}, true);  // Covers the anchors at cells (0..1, 0..1).
  const Assignment result = assign_anchors(s.input());
  for (int y = 0; y < kCells; ++y) {
    for (int x = 0; x < kCells; ++x) {
      const std::size_t a = static_cast<std::size_t>(y * kCells + x);
      EXPECT_EQ(result.box_of_anchor[a], -1);
      EXPECT_EQ(result.class_weight[a * kClasses], 1);
      EXPECT_EQ(result.class_weight[a * kClasses + 1], x < 2 && y < 2 ? 0 : 1);
    }
  }
}

TEST(Assigner, PositiveAnchorInsideIgnoredBoxIsStillTrained) {
  Scene s;
  s.add(1, {0, 0, 64, 64}, true);
  s.add(1, {10, 10, 40, 40});
  const Assignment result = assign_anchors(s.input());
  for (std::size_t a = 0; a < result.box_of_anchor.size(); ++a) {
    EXPECT_EQ(result.class_weight[a * kClasses + 1], result.box_of_anchor[a] == 1 ? 1 : 0);
  }
}

}  // namespace
}  // namespace segsim::perception
