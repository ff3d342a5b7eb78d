/// @file
/// With K = all a whole picture's labels, scores and features are those of dense blending:
/// every surfel's row times its weight, summed in double precision.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "tests/renderer/panoptic_scenes.h"
#include "tests/renderer/surfel_weights.h"

namespace segsim::renderer {
namespace {

using core::Channels;
using core::Frame;
using testing::kOddCamera;
using testing::SceneKind;
using testing::View;
using testing::Weights;

/// Weighted mean of rows.
/// @param row_of  Gives a surfel's row of `size` numbers.
template <class RowOf>
std::vector<double> dense_mean(const Weights& weights, std::size_t size, const RowOf& row_of) {
  std::vector<double> mean(size, 0.0);
  double total = 0.0;
  for (std::size_t s = 0; s < weights.size(); ++s) {
    const auto w = static_cast<double>(weights[s]);
    if (w == 0.0) continue;
    total += w;
    const auto& row = row_of(s);
    for (std::size_t i = 0; i < size; ++i) mean[i] += w * static_cast<double>(row[i]);
  }
  for (double& m : mean) m /= total;
  return mean;
}

/// A view whose surfels have features.
View featured(SceneKind kind, int i) {
  View view = testing::view_of(kind, i);
  SurfelCloud cloud = *view.scene;
  testing::add_random_features(cloud, 17 + static_cast<std::uint64_t>(i));
  view.scene = std::make_shared<const SurfelCloud>(std::move(cloud));
  return view;
}

class DenseBlending : public ::testing::TestWithParam<SceneKind> {};

TEST_P(DenseBlending, OfFeatures) {
  double worst = 0.0, largest = 0.0;
  for (int i = 0; i < 8; ++i) {
    const View view = featured(GetParam(), i);
    const std::vector<Weights> weights = testing::weights_of(view);
    const Frame frame = make_cpu_renderer(view.scene, {.top_k = kAllSurfels, .threads = 1})
                            ->render(view.pose, kOddCamera, Channels::kFeatures);
    const auto compare = [&](const std::vector<double>& mean, const auto& feature) {
      for (std::size_t c = 0; c < mean.size(); ++c) {
        worst = std::max(worst, std::abs(static_cast<double>(feature[c]) - mean[c]));
        largest = std::max(largest, std::abs(mean[c]));
      }
    };
    const SurfelCloud& cloud = *view.scene;
    for (std::size_t p = 0; p < weights.size(); ++p) {
      compare(dense_mean(weights[p], core::kSemanticFeatureSize,
                         [&](std::size_t s) { return cloud.semantic_feature[s]; }),
              frame.semantic_feature.pixels()[p]);
      compare(dense_mean(weights[p], core::kInstanceFeatureSize,
                         [&](std::size_t s) { return cloud.instance_feature[s]; }),
              frame.instance_feature.pixels()[p]);
    }
  }
  EXPECT_LT(worst, 1e-6 * largest);
  RecordProperty("worst_1e-9", std::to_string(1e9 * worst / largest));
}

TEST_P(DenseBlending, OfOwnLabels) {
  constexpr std::size_t kIds = 64;
  int off = 0;
  double worst = 0.0;
  const auto one_hot = [](const std::vector<std::uint16_t>& ids) {
    return [&ids](std::size_t s) {
      std::vector<double> row(kIds, 0.0);
      row[ids[s]] = 1.0;
      return row;
    };
  };
  for (int i = 0; i < 8; ++i) {
    const View view = testing::view_of(GetParam(), i);
    const std::vector<Weights> weights = testing::weights_of(view);
    const Frame frame = make_cpu_renderer(view.scene, {.top_k = kAllSurfels, .threads = 1})
                            ->render(view.pose, kOddCamera, Channels::kLabels);
    const auto compare = [&](const std::vector<double>& mean, std::uint16_t id,
                             float confidence) {
      const double best = *std::max_element(mean.begin(), mean.end());
      worst = std::max(worst, std::abs(static_cast<double>(confidence) - best));
      off += best - mean[id] > 1e-6 ? 1 : 0;
    };
    for (std::size_t p = 0; p < weights.size(); ++p) {
      compare(dense_mean(weights[p], kIds, one_hot(view.scene->semantic_id)),
              frame.semantic.pixels()[p], frame.confidence.pixels()[p]);
      compare(dense_mean(weights[p], kIds, one_hot(view.scene->instance_id)),
              frame.instance.pixels()[p], frame.instance_confidence.pixels()[p]);
    }
  }
  EXPECT_EQ(off, 0);
  EXPECT_LT(worst, 1e-6);
}

TEST_P(DenseBlending, OfAPanopticField) {
  constexpr int kClasses = 9, kQueries = 40;
  const PanopticModel model = testing::random_model(3, kClasses, kQueries, 0.1F, 1.2);
  int off = 0, things = 0;
  double worst = 0.0;
  for (int i = 0; i < 2; ++i) {  // The dense softmax is slow.
    const View view = featured(GetParam(), i);
    const SurfelCloud& cloud = *view.scene;
    const auto field = std::make_shared<const PanopticField>(fold_panoptic_model(
        cloud, model,
        {.max_classes = kClasses, .max_instances = kQueries, .min_excess = 0.0F}));
    std::vector<std::vector<double>> classes, instances;
    for (std::size_t s = 0; s < cloud.size(); ++s) {
      classes.push_back(testing::dense_classes(model, cloud, s));
      instances.push_back(testing::dense_instances(model, cloud, s));
    }
    const std::vector<Weights> weights = testing::weights_of(view);
    const Frame frame =
        make_cpu_renderer(view.scene, {.top_k = kAllSurfels, .threads = 1}, field)
            ->render(view.pose, kOddCamera, Channels::kLabels);
    for (std::size_t p = 0; p < weights.size(); ++p) {
      const auto mean =
          dense_mean(weights[p], kClasses, [&](std::size_t s) { return classes[s]; });
      const auto best =
          static_cast<std::size_t>(std::max_element(mean.begin(), mean.end()) - mean.begin());
      const auto confidence = static_cast<double>(frame.confidence.pixels()[p]);
      worst = std::max(worst, std::abs(confidence - mean[best]));
      const std::uint16_t id = frame.semantic.pixels()[p];  // random_model(): 3 c.
      off += mean[best] - mean[id / 3U] > 1e-5 ? 1 : 0;
      if (!model.classes[id / 3U].thing) continue;
      ++things;
      const auto queries =
          dense_mean(weights[p], kQueries, [&](std::size_t s) { return instances[s]; });
      const double score = *std::max_element(queries.begin(), queries.end());
      const auto instance_confidence =
          static_cast<double>(frame.instance_confidence.pixels()[p]);
      worst = std::max(worst, std::abs(instance_confidence - score));
      const std::size_t query = (frame.instance.pixels()[p] - 7U) / 2U;
      off += score - queries[query] > 1e-5 ? 1 : 0;
    }
  }
  EXPECT_GT(things, 100);
  EXPECT_EQ(off, 0);
  EXPECT_LT(worst, 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Scenes, DenseBlending,
                         ::testing::Values(SceneKind::kOutside, SceneKind::kInside,
                                           SceneKind::kRoom),
                         [](const auto& kind) { return testing::name_of(kind.param); });

}  // namespace
}  // namespace segsim::renderer
