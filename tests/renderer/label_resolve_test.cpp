#include "renderer/internal/label_resolve.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>

#include "core/random.h"
#include "renderer/internal/tile_state.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::renderer::internal {
namespace {

using core::Channels;
using renderer::testing::dense_classes;
using renderer::testing::dense_instances;

std::uint32_t random_index(core::RandomStream& random, std::size_t count) {
  return random.index(static_cast<std::uint32_t>(count));
}

float random_weight(core::RandomStream& random) {
  return static_cast<float>(std::exp(random.uniform(-8.0, 0.0)));
}

std::uint32_t label_of(std::uint32_t semantic, std::uint32_t instance) {
  return semantic | instance << 16U;
}

/// A scene with features, its field without losses, and selections from it.
class Panoptic : public ::testing::Test {
 protected:
  Panoptic()
      : model_(renderer::testing::random_model(3, 9, 40, 0.1F, 1.2)),
        cloud_(renderer::testing::random_scene(5, 400)) {
    renderer::testing::add_random_features(cloud_, 9);
    field_ = fold_panoptic_model(cloud_, model_,
                                 {.max_classes = 9, .max_instances = 40, .min_excess = 0.0F});
  }

  std::vector<WeightedSurfel> random_selection(core::RandomStream& random, int count) const {
    std::vector<WeightedSurfel> selected;
    for (int i = 0; i < count; ++i) {
      selected.push_back({random_weight(random), random_index(random, cloud_.size())});
    }
    return selected;
  }

  /// Dense blending in double precision of rows given by a function of the surfel.
  template <class Row>
  static std::vector<double> blend(const std::vector<WeightedSurfel>& selected,
                                   const Row& row_of) {
    std::vector<double> mean;
    double total = 0.0;
    for (const WeightedSurfel& s : selected) {
      const std::vector<double> row = row_of(s.surfel);
      mean.resize(row.size(), 0.0);
      for (std::size_t i = 0; i < row.size(); ++i) {
        mean[i] += static_cast<double>(s.weight) * row[i];
      }
      total += static_cast<double>(s.weight);
    }
    for (double& m : mean) m /= total;
    return mean;
  }
  [[nodiscard]] std::vector<double> blended_classes(
      const std::vector<WeightedSurfel>& selected) const {
    return blend(selected, [&](std::uint32_t s) { return dense_classes(model_, cloud_, s); });
  }
  [[nodiscard]] std::vector<double> blended_instances(
      const std::vector<WeightedSurfel>& selected) const {
    return blend(selected,
                 [&](std::uint32_t s) { return dense_instances(model_, cloud_, s); });
  }

  PanopticModel model_;
  SurfelCloud cloud_;
  PanopticField field_;
};

/// The id at the largest score, and whether another comes within 1e-5 of it.
struct ArgMax {
  std::size_t index;
  double score;
  bool tied;
};
ArgMax arg_max(const std::vector<double>& scores) {
  const auto best = static_cast<std::size_t>(std::max_element(scores.begin(), scores.end()) -
                                             scores.begin());
  bool tied = false;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    tied |= i != best && scores[best] - scores[i] < 1e-5;
  }
  return {best, scores[best], tied};
}

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

TEST_F(Panoptic, FeaturesAreTheWeightedMean) {
  core::RandomStream random(4, "selections");
  for (const int count : {1, 3, 4, 8, 16, 24, 25, 3000}) {
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

/// One tile, filled as the blend loop would: a stack of surfels for every pixel.
class TileEnd : public Panoptic {
 protected:
  static constexpr int kWidth = 16, kHeight = 13;  ///< The last rows lie outside the image.

  TileEnd() {
    core::RandomStream random(6, "stacks");
    for (std::vector<WeightedSlot>& stack : stacks_) {
      const std::size_t count = 1 + random.index(60);
      float transmittance = 1.0F;
      for (std::size_t i = 0; i < count; ++i) {
        const float alpha = static_cast<float>(random.uniform(0.004, 0.3));
        stack.push_back({alpha * transmittance, random_index(random, cloud_.size())});
        transmittance *= 1.0F - alpha;
      }
    }
    // Slots are not surfels.
    for (std::size_t i = 0; i < cloud_.size(); ++i) {
      SurfelShade shade{};
      shade.surfel = static_cast<std::uint32_t>((i * 7 + 3) % cloud_.size());
      shade.label =
          label_of(cloud_.semantic_id[shade.surfel], cloud_.instance_id[shade.surfel]);
      projected_.shade.push_back(shade);
      list_.push_back(static_cast<std::uint32_t>(i));
    }
    std::reverse(list_.begin(), list_.end());  // Positions are not slots.
    frame_.intrinsics = {kWidth, kHeight, 20.0, 20.0, 8.0, 6.5};
    for (auto* image : {&frame_.alpha, &frame_.confidence, &frame_.instance_confidence}) {
      *image = core::Image<float>(kWidth, kHeight);
    }
    frame_.semantic = frame_.instance = core::Image<std::uint16_t>(kWidth, kHeight, 60000);
    frame_.semantic_feature = core::Image<core::SemanticFeature>(kWidth, kHeight);
    frame_.instance_feature = core::Image<core::InstanceFeature>(kWidth, kHeight);
  }

  [[nodiscard]] std::uint32_t position_of(std::uint32_t slot) const {
    return static_cast<std::uint32_t>(list_.size()) - 1 - slot;
  }

  void fill(const ResolveJob& resolve, TileState& state) const {
    for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
      std::vector<std::uint32_t> keys;
      for (const WeightedSlot& s : stacks_[pixel]) {
        if (resolve.top_k == kAllSurfels) accumulate_all(state, pixel, s.weight, s.slot);
        keys.push_back((std::bit_cast<std::uint32_t>(s.weight) & ~kKeyPositionMask) |
                       position_of(s.slot));
        state.transmittance[pixel] -= s.weight;
      }
      const std::size_t kept = std::min(keys.size(), static_cast<std::size_t>(resolve.top_k));
      if (resolve.rule == TopKRule::kFirst) keys.resize(kept);
      std::sort(keys.rbegin(), keys.rend());
      for (std::size_t k = 0; k < kept; ++k) state.keys[k][pixel] = keys[k];
    }
  }

  /// Surfels that the rule takes from a pixel's stack.
  [[nodiscard]] std::vector<WeightedSurfel> expected(const ResolveJob& resolve,
                                                     std::size_t pixel) const {
    std::vector<WeightedSurfel> all;
    for (const WeightedSlot& s : stacks_[pixel]) {
      all.push_back({s.weight, projected_.shade[s.slot].surfel});
    }
    if (resolve.top_k == kAllSurfels) return all;
    if (resolve.rule == TopKRule::kHeaviest) {
      std::stable_sort(all.begin(), all.end(),
                       [](const auto& a, const auto& b) { return a.weight > b.weight; });
    }
    all.resize(std::min(all.size(), static_cast<std::size_t>(resolve.top_k)));
    return all;
  }

  std::uint64_t write(const ResolveJob& resolve, Channels channels) {
    const RasterJob job{.projected = projected_,
                        .bins = bins_,
                        .frame = frame_,
                        .channels = channels,
                        .top_k = resolve.top_k,
                        .median_depth = true,
                        .labelled = resolve.labelled,
                        .resolve = &resolve};
    const auto state = std::make_unique<TileState>();
    clear_tile(job, 0, resolve.top_k, *state);
    fill(resolve, *state);
    return write_tile(job, 0, list_, 0, *state);
  }

  /// Calls body(pixel, x, y) where there is a surface, and expects emptiness elsewhere.
  template <class Body>
  void for_each_surface(const Body& body) {
    int surfaces = 0;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        if (std::abs(frame_.alpha(x, y) - 0.5F) < 1e-5F) continue;
        if (frame_.alpha(x, y) < 0.5F) {
          EXPECT_EQ(frame_.semantic(x, y), 0);
          EXPECT_EQ(frame_.instance(x, y), 0);
          EXPECT_EQ(frame_.confidence(x, y), 0.0F);
          EXPECT_EQ(frame_.instance_confidence(x, y), 0.0F);
          continue;
        }
        ++surfaces;
        body(plane_index(x, y), x, y);
      }
    }
    EXPECT_GT(surfaces, 100);
    EXPECT_LT(surfaces, kWidth * kHeight);
  }

  std::array<std::vector<WeightedSlot>, kTilePixels> stacks_;
  ProjectedSurfels projected_;
  std::vector<std::uint32_t> list_;
  TileBins bins_;
  core::Frame frame_;
};

constexpr std::array<int, 7> kTopKs = {1, 3, 4, 8, 16, 24, kAllSurfels};

TEST_F(TileEnd, OwnLabelsByBothRulesAndEveryK) {
  for (const TopKRule rule : {TopKRule::kHeaviest, TopKRule::kFirst}) {
    for (const int top_k : kTopKs) {
      SCOPED_TRACE(top_k);
      const ResolveJob resolve{
          .cloud = &cloud_, .labelled = true, .top_k = top_k, .rule = rule};
      const std::uint64_t read = write(resolve, Channels::kLabels);
      EXPECT_GT(read, 0U);
      int off = 0;
      for_each_surface([&](std::size_t pixel, int x, int y) {
        std::vector<WeightedLabel> labels;
        for (const WeightedSurfel& s : expected(resolve, pixel)) {
          labels.push_back({s.weight, label_of(cloud_.semantic_id[s.surfel],
                                               cloud_.instance_id[s.surfel])});
        }
        const PixelLabel label = vote(labels);
        off += frame_.semantic(x, y) != label.semantic ? 1 : 0;
        off += frame_.instance(x, y) != label.instance ? 1 : 0;
        // A key keeps 5e-4 of a weight; two that differ by less may change places.
        EXPECT_NEAR(frame_.confidence(x, y), label.confidence, 0.02F);
        EXPECT_NEAR(frame_.instance_confidence(x, y), label.instance_confidence, 0.02F);
      });
      EXPECT_LE(off, top_k == kAllSurfels ? 0 : 2);
    }
  }
}

TEST_F(TileEnd, KeepingAllIsDenseBlending) {
  const ResolveJob resolve{.cloud = &cloud_, .field = &field_, .top_k = kAllSurfels};
  write(resolve, Channels::kLabels | Channels::kFeatures);
  for_each_surface([&](std::size_t pixel, int x, int y) {
    const std::vector<WeightedSurfel> all = expected(resolve, pixel);
    const ArgMax best_class = arg_max(blended_classes(all));
    EXPECT_NEAR(static_cast<double>(frame_.confidence(x, y)), best_class.score, 1e-6);
    if (!best_class.tied) {
      EXPECT_EQ(frame_.semantic(x, y), model_.classes[best_class.index].id);
    }
    if (frame_.instance(x, y) != 0) {
      const ArgMax best_instance = arg_max(blended_instances(all));
      EXPECT_NEAR(static_cast<double>(frame_.instance_confidence(x, y)), best_instance.score,
                  1e-6);
    }
    const auto semantic = blend(all, [&](std::uint32_t s) {
      return std::vector<double>(cloud_.semantic_feature[s].begin(),
                                 cloud_.semantic_feature[s].end());
    });
    for (std::size_t i = 0; i < semantic.size(); ++i) {
      EXPECT_NEAR(static_cast<double>(frame_.semantic_feature(x, y)[i]), semantic[i], 1e-6);
    }
  });
}

TEST_F(TileEnd, FeaturesOfTheTopKAreRenormalised) {
  for (const TopKRule rule : {TopKRule::kHeaviest, TopKRule::kFirst}) {
    for (const int top_k : {1, 4, 8}) {
      SCOPED_TRACE(top_k);
      const ResolveJob resolve{.cloud = &cloud_, .top_k = top_k, .rule = rule};
      write(resolve, Channels::kFeatures);
      int off = 0;
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) {
          if (frame_.alpha(x, y) < 0.5F) {
            EXPECT_EQ(frame_.instance_feature(x, y), core::InstanceFeature{});
            continue;
          }
          const auto mean = blend(expected(resolve, plane_index(x, y)), [&](std::uint32_t s) {
            return std::vector<double>(cloud_.instance_feature[s].begin(),
                                       cloud_.instance_feature[s].end());
          });
          for (std::size_t i = 0; i < mean.size(); ++i) {
            off += std::abs(static_cast<double>(frame_.instance_feature(x, y)[i]) - mean[i]) >
                           5e-3
                       ? 1
                       : 0;
          }
        }
      }
      EXPECT_LE(off, 2 * 32);  // Two pixels whose last two weights are nearly equal.
    }
  }
}

TEST_F(TileEnd, RowsOfABlockAreFetchedOnce) {
  for (auto& stack : stacks_) stack = {{0.6F, 11}, {0.2F, 12}, {0.1F, 13}};
  const ResolveJob rows{.cloud = &cloud_, .field = &field_, .top_k = 3};
  EXPECT_EQ(write(rows, Channels::kLabels), 3 * kTilePixels / BlockResolver::kBlockPixels);
  const ResolveJob labels{.cloud = &cloud_, .labelled = true, .top_k = 2};
  EXPECT_EQ(write(labels, Channels::kLabels), 2 * kTilePixels);
  const ResolveJob all{.cloud = &cloud_, .labelled = true, .top_k = kAllSurfels};
  EXPECT_EQ(write(all, Channels::kLabels), 3 * kTilePixels);
  EXPECT_EQ(write(all, Channels::kNone), 0U);
}

TEST_F(TileEnd, SceneWithoutLabelsOrFeaturesIsVoid) {
  const SurfelCloud bare;
  const ResolveJob resolve{.cloud = &bare, .top_k = 3};
  frame_.semantic_feature(3, 3)[2] = 5.0F;
  EXPECT_EQ(write(resolve, Channels::kLabels | Channels::kFeatures), 0U);
  EXPECT_FALSE(wants_candidates(resolve, Channels::kLabels | Channels::kFeatures));
  EXPECT_EQ(frame_.semantic(3, 3), 0);
  EXPECT_EQ(frame_.semantic_feature(3, 3), core::SemanticFeature{});
}

TEST_F(TileEnd, WindowsAreJoinedByTheRule) {
  // Three windows of one surfel each for every pixel, the last one the heaviest.
  const std::array<float, 3> weights = {0.2F, 0.125F, 0.5F};
  for (const TopKRule rule : {TopKRule::kHeaviest, TopKRule::kFirst}) {
    const ResolveJob resolve{.cloud = &cloud_, .labelled = true, .top_k = 2, .rule = rule};
    const RasterJob job{.projected = projected_,
                        .bins = bins_,
                        .frame = frame_,
                        .channels = Channels::kLabels,
                        .top_k = 2,
                        .median_depth = true,
                        .labelled = true,
                        .resolve = &resolve};
    const auto state = std::make_unique<TileState>();
    clear_tile(job, 0, 2, *state);
    // Windows of 100 list entries here; the surfel is the window's entry 5.
    for (std::uint32_t window = 0; window < 3; ++window) {
      if (window > 0) close_window(job, list_, 100 * (window - 1), *state);
      for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
        state->keys[0][pixel] =
            (std::bit_cast<std::uint32_t>(weights[window]) & ~kKeyPositionMask) | 5U;
        state->transmittance[pixel] -= weights[window];
      }
    }
    for (std::uint32_t window = 0; window < 3; ++window) {
      projected_.shade[list_[100 * window + 5]].label = label_of(window + 1, window + 11);
    }
    write_tile(job, 0, list_, 200, *state);
    const bool first = rule == TopKRule::kFirst;
    EXPECT_EQ(frame_.semantic(4, 4), first ? 1 : 3);
    EXPECT_EQ(frame_.instance(4, 4), first ? 11 : 13);
    EXPECT_NEAR(frame_.confidence(4, 4), first ? 0.2F / 0.325F : 0.5F / 0.7F, 1e-3F);
  }
}

TEST_F(TileEnd, AVectorOfWeightsIsLoggedWithoutItsZeros) {
  const auto state = std::make_unique<TileState>();
  CandidateLog log;
  state->log = &log;
  const std::array<float, 4> weights = {0.5F, 0.0F, 0.25F, 0.0F};
  accumulate_all(*state, 32, weights.data(), weights.size(), 9);
  ASSERT_EQ(log.size(), 2U);
  EXPECT_EQ(log[0].pixel, 32U);
  EXPECT_EQ(log[1].pixel, 34U);
  EXPECT_EQ(log[1].weight, 0.25F);
  EXPECT_EQ(log[1].slot, 9U);
}

}  // namespace
}  // namespace segsim::renderer::internal
