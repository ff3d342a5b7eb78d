#include "perception/internal/loss/loss_targets.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

#include "core/random.h"

namespace segsim::perception {
namespace {

constexpr int kSide_px = 64, kClasses = 3;
constexpr int64_t kBatch = 4;

struct Scene {
  torch::Tensor scores, boxes;
  std::vector<std::vector<LabeledBox>> truth;
};

core::BoxPx random_box(core::RandomStream& random) {
  const auto at = [&](double low, double high) {
    return static_cast<float>(random.uniform(low, high));
  };
  const float x = at(0.0, 40.0), y = at(0.0, 40.0);
  return {x, y, x + at(4.0, 30.0), y + at(4.0, 30.0)};
}

/// Predictions near the labels, so that anchors are contested. The last image has no label;
/// one label of the first occurs twice.
Scene random_scene(std::uint64_t seed) {
  core::RandomStream random(seed, "scene");
  Scene scene;
  scene.truth.resize(kBatch);
  for (int64_t image = 0; image + 1 < kBatch; ++image) {
    for (int i = 0; i < 7; ++i) {
      LabeledBox label;
      label.class_index = static_cast<int>(random.index(kClasses));
      label.box = random_box(random);
      label.ignore = i == 5;
      label.crowd = i == 6;
      scene.truth[static_cast<std::size_t>(image)].push_back(label);
    }
  }
  scene.truth[0][1] = scene.truth[0][0];
  const int64_t anchors = make_anchors(kSide_px, torch::kFloat32).stride_px.numel();
  std::vector<float> boxes, scores;
  for (const auto& labels : scene.truth) {
    for (int64_t a = 0; a < anchors; ++a) {
      core::BoxPx box = random_box(random);
      if (!labels.empty() && random.index(4) != 0) {
        box = labels[random.index(static_cast<std::uint32_t>(labels.size()))].box;
        const auto shift = static_cast<float>(random.uniform(-3.0, 3.0));
        box.x0 += shift;
        box.y1 += shift;
      }
      boxes.insert(boxes.end(), {box.x0, box.y0, box.x1, box.y1});
      for (int c = 0; c < kClasses; ++c) {
        scores.push_back(static_cast<float>(random.uniform(-0.1, 1.0)));
        if (scores.back() < 0.0F) scores.back() = 0.0F;
      }
    }
  }
  scene.boxes = torch::tensor(boxes).view({kBatch, anchors, 4});
  scene.scores = torch::tensor(scores).view({kBatch, anchors, kClasses});
  return scene;
}

void expect_equal(const LossTargets& found, const LossTargets& wanted) {
  EXPECT_TRUE(torch::equal(found.row, wanted.row));
  EXPECT_TRUE(torch::equal(found.anchor, wanted.anchor));
  EXPECT_TRUE(torch::equal(found.box, wanted.box));
  EXPECT_TRUE(torch::equal(found.class_weight, wanted.class_weight));
  EXPECT_TRUE(torch::allclose(found.weight, wanted.weight, 1e-6, 1e-7));
  EXPECT_TRUE(torch::allclose(found.score, wanted.score, 1e-6, 1e-7));
  EXPECT_NEAR(found.score_sum, wanted.score_sum, 1e-5);
}

TEST(LossTargets, AreTheSameByTensorsAndByLoops) {
  const Anchors anchors = make_anchors(kSide_px, torch::kFloat32);
  bool rules_differ = false, some_not_judged = false;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Scene scene = random_scene(seed);
    std::vector<torch::Tensor> boxes_by_rule;
    for (const AssignerRule& rule : {AssignerRule{}, kYoloRule}) {
      const auto on = [&](auto targets) {
        return targets(scene.scores, scene.boxes, anchors, scene.truth, rule);
      };
      const LossTargets wanted = on(targets_on_host);
      ASSERT_GT(wanted.row.numel(), 3);
      expect_equal(on(targets_on_device), wanted);
      boxes_by_rule.push_back(wanted.box);
      some_not_judged |= wanted.class_weight.min().item<float>() == 0.0F;
    }
    rules_differ |= !torch::equal(boxes_by_rule[0], boxes_by_rule[1]);
  }
  // Guards: anchors were contested, and labels were ignored.
  EXPECT_TRUE(rules_differ);
  EXPECT_TRUE(some_not_judged);
}

TEST(LossTargets, WithoutAnythingToFindAreBackground) {
  const Anchors anchors = make_anchors(kSide_px, torch::kFloat32);
  Scene scene = random_scene(1);
  std::vector<std::vector<LabeledBox>> ignored(kBatch), outside(kBatch);
  ignored[2].push_back(scene.truth[0][6]);
  outside[1].push_back(scene.truth[0][0]);
  outside[1][0].box = {31.0F, 31.0F, 31.5F, 31.5F};  // No anchor's centre lies in it.
  const std::vector<std::vector<LabeledBox>> nothing(kBatch);
  for (const auto& truth : {nothing, ignored, outside}) {
    const LossTargets wanted =
        targets_on_host(scene.scores, scene.boxes, anchors, truth, kYoloRule);
    EXPECT_EQ(wanted.row.numel(), 0);
    EXPECT_EQ(wanted.score.abs().max().item<float>(), 0.0F);
    expect_equal(targets_on_device(scene.scores, scene.boxes, anchors, truth, kYoloRule),
                 wanted);
  }
}

/// As after a step that went wrong: the loss shall be no number, not the program end.
TEST(LossTargets, OfPredictionsThatAreNoNumbersAreBackground) {
  const Anchors anchors = make_anchors(kSide_px, torch::kFloat32);
  const Scene scene = random_scene(2);
  const auto boxes = torch::full_like(scene.boxes, std::nan(""));
  for (const auto targets : {targets_on_host, targets_on_device}) {
    EXPECT_EQ(targets(scene.scores, boxes, anchors, scene.truth, kYoloRule).row.numel(), 0);
  }
}

}  // namespace
}  // namespace segsim::perception
