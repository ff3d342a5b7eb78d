// Panoptic images of the fast renderer against dense blending: the weights of the reference
// geometry and the dense softmax over all classes and queries, all in double precision.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "core/frames.h"
#include "renderer/cpu_renderer.h"
#include "renderer/internal/reference_surfels.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::renderer {
namespace {

using core::Channels;

using Weights = std::vector<std::pair<double, std::size_t>>;  ///< (alpha T, surfel)

/// Weights of a pixel in order of depth, and those that a rule selects from them.
Weights weights_of(const internal::ReferenceSurfels& surfels, const glm::dvec2& px) {
  Weights weights;
  double transmittance = 1.0;
  for (const internal::ReferenceSurfel& s : surfels.sorted()) {
    const double alpha = surfels.meet(s, px).alpha;
    if (alpha == 0.0) continue;
    if (transmittance * (1.0 - alpha) < static_cast<double>(kStopTransmittance)) break;
    weights.emplace_back(alpha * transmittance, s.index);
    transmittance *= 1.0 - alpha;
  }
  return weights;
}

Weights selected(Weights weights, const RenderOptions& options) {
  if (options.top_k == kAllSurfels) return weights;
  if (options.top_k_rule == TopKRule::kHeaviest) {
    std::stable_sort(weights.begin(), weights.end(),
                     [](const auto& a, const auto& b) { return a.first > b.first; });
  }
  weights.resize(std::min(weights.size(), static_cast<std::size_t>(options.top_k)));
  return weights;
}

/// Weighted mean of dense rows, and its largest entry.
std::pair<std::size_t, double> best_of(const Weights& weights,
                                       const std::vector<std::vector<double>>& rows) {
  std::vector<double> mean(rows[0].size());
  double total = 0.0;
  for (const auto& [weight, surfel] : weights) {
    for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += weight * rows[surfel][i];
    total += weight;
  }
  const auto best = std::max_element(mean.begin(), mean.end());
  return {static_cast<std::size_t>(best - mean.begin()), *best / total};
}

class PanopticImages : public ::testing::TestWithParam<RenderOptions> {};

TEST_P(PanopticImages, AreDenseBlendingOfTheSelection) {
  const RenderOptions options = GetParam();
  SurfelCloud cloud = testing::random_scene(31, 700, 0.3F);
  testing::add_random_features(cloud, 32);
  PanopticModel model = testing::random_model(33, 6, 30, 0.1F, 1.2);
  const auto scene = std::make_shared<const SurfelCloud>(std::move(cloud));
  const auto field = std::make_shared<const PanopticField>(fold_panoptic_model(
      *scene, model, {.max_classes = 6, .max_instances = 30, .min_excess = 0.0F}));
  std::vector<std::vector<double>> classes, instances;
  for (std::size_t i = 0; i < scene->size(); ++i) {
    classes.push_back(testing::dense_classes(model, *scene, i));
    instances.push_back(testing::dense_instances(model, *scene, i));
  }
  const core::CameraPose pose = core::look_at({-3.5, 0.4, 1.0}, {0.0, 0.0, 0.0});
  const core::CameraIntrinsics camera{53, 41, 48.0, 44.0, 25.3, 21.8};
  const core::Frame frame =
      make_cpu_renderer(scene, options, field)
          ->render(pose, camera, Channels::kLabels | Channels::kRgb | Channels::kFeatures);
  const internal::ReferenceSurfels surfels(*scene, options, pose, camera);
  int pixels = 0, off = 0;
  for (int y = 0; y < camera.height_px; ++y) {
    for (int x = 0; x < camera.width_px; ++x) {
      if (frame.alpha(x, y) < 0.51F) continue;
      const Weights weights = selected(weights_of(surfels, {x + 0.5, y + 0.5}), options);
      ASSERT_FALSE(weights.empty());
      const auto [c, class_score] = best_of(weights, classes);
      const auto [q, instance_score] = best_of(weights, instances);
      double total = 0.0, feature = 0.0;
      for (const auto& [weight, surfel] : weights) {
        total += weight;
        feature += weight * static_cast<double>(scene->instance_feature[surfel][5]);
      }
      bool same = frame.semantic(x, y) == model.classes[c].id;
      same &= std::abs(static_cast<double>(frame.confidence(x, y)) - class_score) < 2e-3;
      same &= std::abs(static_cast<double>(frame.instance_feature(x, y)[5]) -
                       feature / total) < 5e-3;
      if (model.classes[c].thing) {
        same &= frame.instance(x, y) == model.queries[q].id;
        same &= std::abs(static_cast<double>(frame.instance_confidence(x, y)) -
                         instance_score) < 2e-3;
      } else {
        same &= frame.instance(x, y) == 0;
      }
      ++pixels;
      off += same ? 0 : 1;
    }
  }
  EXPECT_GT(pixels, 800);
  // Where a surfel's alpha is at 1/255, or two weights or scores are nearly equal.
  EXPECT_LE(off, pixels / 100);
}

INSTANTIATE_TEST_SUITE_P(
    EveryK, PanopticImages,
    ::testing::Values(
        RenderOptions{.top_k = kAllSurfels, .threads = 1},
        RenderOptions{.top_k = 1, .threads = 1}, RenderOptions{.top_k = 3, .threads = 1},
        RenderOptions{.top_k = 4, .threads = 0}, RenderOptions{.top_k = 8, .threads = 1},
        RenderOptions{.top_k = 24, .threads = 1},
        RenderOptions{.top_k = 4, .top_k_rule = TopKRule::kFirst, .threads = 1},
        RenderOptions{.top_k = 16, .top_k_rule = TopKRule::kFirst, .threads = 1}));

}  // namespace
}  // namespace segsim::renderer
