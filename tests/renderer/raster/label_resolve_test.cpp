#include "renderer/raster/label_resolve.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/random.h"
#include "tests/renderer/raster/panoptic_fixture.h"

namespace segsim::renderer::internal {
namespace {

using renderer::testing::arg_max;
using renderer::testing::ArgMax;
using renderer::testing::Panoptic;

TEST_F(Panoptic, EqualsDenseBlendingForEveryK) {
  core::RandomStream random(2, "selections");
  ResolveScratch scratch;
  int things = 0, stuff = 0;
  for (const int count : {1, 3, 4, 8, 16, 24, 200}) {
    for (int repeat = 0; repeat < 40; ++repeat) {
      const std::vector<WeightedSurfel> selected = random_selection(random, count);
      const PixelLabel label = resolve_panoptic(field_, selected, scratch);
      const ArgMax best_class = arg_max(blended_classes(selected));
      const ArgMax best_instance = arg_max(blended_instances(selected));
      EXPECT_NEAR(static_cast<double>(label.confidence), best_class.score, 1e-6);
      if (best_class.tied) continue;
      EXPECT_EQ(label.semantic, model_.classes[best_class.index].id);
      if (!model_.classes[best_class.index].thing) {
        EXPECT_EQ(label.instance, 0);
        EXPECT_EQ(label.instance_confidence, label.confidence);
        ++stuff;
        continue;
      }
      ++things;
      EXPECT_NEAR(static_cast<double>(label.instance_confidence), best_instance.score, 1e-6);
      if (!best_instance.tied) {
        EXPECT_EQ(label.instance, model_.queries[best_instance.index].id);
      }
    }
  }
  EXPECT_GT(things, 50);
  EXPECT_GT(stuff, 50);
}

TEST_F(Panoptic, SparseRowsLackTheirDroppedMassAtMost) {
  const PanopticField sparse = fold_panoptic_model(
      cloud_, model_, {.max_classes = 4, .max_instances = 4, .min_excess = 1e-3F});
  core::RandomStream random(3, "selections");
  ResolveScratch scratch;
  for (int repeat = 0; repeat < 200; ++repeat) {
    const std::vector<WeightedSurfel> selected = random_selection(random, 4);
    const PixelLabel label = resolve_panoptic(sparse, selected, scratch);
    const double best = arg_max(blended_classes(selected)).score;
    EXPECT_LE(static_cast<double>(label.confidence), best + 1e-6);
    EXPECT_GE(static_cast<double>(label.confidence), best - sparse.dropped_classes.max - 1e-6);
  }
}

TEST_F(Panoptic, PixelsThatNoQueryClaimsHaveNoInstance) {
  for (InstanceQuery& q : model_.queries) q.position_m += glm::vec3(500.0F);
  for (PanopticClass& c : model_.classes) c.thing = true;
  const PanopticField field = fold_panoptic_model(cloud_, model_);
  ResolveScratch scratch;
  const std::vector<WeightedSurfel> selected = {{0.5F, 3}, {0.25F, 8}};
  const PixelLabel label = resolve_panoptic(field, selected, scratch);
  EXPECT_EQ(label.instance, 0);
  EXPECT_EQ(label.instance_confidence, 0.0F);
  EXPECT_GT(label.confidence, 0.0F);
  EXPECT_EQ(resolve_panoptic(field, {}, scratch).confidence, 0.0F);
}

TEST_F(Panoptic, AQuerysClassIsItsPixelsClassAndUnclaimedThingsAreVoid) {
  for (PanopticClass& c : model_.classes) c.thing = c.id != 0;
  const std::uint16_t other = model_.classes[5].id;
  model_.variant = LabelVariant::kNormalised;
  model_.none_score = 0.05F;
  PanopticField field = fold_panoptic_model(cloud_, model_);
  field.instance_class.assign(field.instance_id.size(), 0);
  for (std::size_t q = 0; q < model_.queries.size(); ++q) {
    field.instance_class[q] = q % 2 == 0 ? other : 0;
  }
  PanopticField without = field;
  without.instance_class.clear();
  core::RandomStream random(6, "selections");
  ResolveScratch scratch;
  int overridden = 0, kept = 0, unclaimed = 0;
  for (int repeat = 0; repeat < 400; ++repeat) {
    const std::vector<WeightedSurfel> selected = random_selection(random, 2);
    const PixelLabel label = resolve_panoptic(field, selected, scratch);
    const PixelLabel plain = resolve_panoptic(without, selected, scratch);
    EXPECT_EQ(label.instance, plain.instance);
    if (plain.semantic == 0) continue;  // The one class that is stuff.
    if (label.instance == 0) {
      ++unclaimed;
      EXPECT_EQ(label.semantic, 0);
    } else if ((label.instance - model_.queries[0].id) / 2 % 2 == 0) {
      ++overridden;
      EXPECT_EQ(label.semantic, other);
    } else {
      ++kept;
      EXPECT_EQ(label.semantic, plain.semantic);
    }
  }
  EXPECT_GT(overridden, 10);
  EXPECT_GT(kept, 10);
  EXPECT_GT(unclaimed, 10);
}

TEST_F(Panoptic, FeaturesAreTheWeightedMean) {
  core::RandomStream random(4, "selections");
  for (const int count : {1, 3, 4, 8, 16, 24}) {
    const std::vector<WeightedSurfel> selected = random_selection(random, count);
    core::SemanticFeature semantic{};
    core::InstanceFeature instance{};
    resolve_features(cloud_, selected, semantic, instance);
    const auto expected_semantic = blend(selected, [&](std::uint32_t s) {
      return std::vector<double>(cloud_.semantic_feature[s].begin(),
                                 cloud_.semantic_feature[s].end());
    });
    const auto expected_instance = blend(selected, [&](std::uint32_t s) {
      return std::vector<double>(cloud_.instance_feature[s].begin(),
                                 cloud_.instance_feature[s].end());
    });
    for (std::size_t i = 0; i < semantic.size(); ++i) {
      EXPECT_NEAR(static_cast<double>(semantic[i]), expected_semantic[i], 1e-6) << count;
    }
    for (std::size_t i = 0; i < instance.size(); ++i) {
      EXPECT_NEAR(static_cast<double>(instance[i]), expected_instance[i], 1e-6) << count;
    }
  }
  core::SemanticFeature semantic;
  core::InstanceFeature instance;
  resolve_features(cloud_, {}, semantic, instance);
  EXPECT_EQ(semantic, core::SemanticFeature{});
  EXPECT_EQ(instance, core::InstanceFeature{});
}

}  // namespace
}  // namespace segsim::renderer::internal
