/// @file
/// The end of a tile: from keys and logs, filled as the blend loop would, to labels and
/// features of the image.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>
#include <vector>

#include "core/random.h"
#include "renderer/raster/tile_write.h"
#include "tests/renderer/make_key.h"
#include "tests/renderer/raster/panoptic_fixture.h"

namespace segsim::renderer::internal {
namespace {

using core::Channels;
using renderer::testing::arg_max;
using renderer::testing::ArgMax;
using renderer::testing::label_of;
using renderer::testing::Panoptic;
using renderer::testing::random_index;

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

  /// As the blend loop does where all surfels count.
  void take(const WeightedSlot& s, std::size_t pixel, AllSurfels& all) const {
    all.log.push_back({s.weight, s.slot, static_cast<std::uint32_t>(pixel)});
    if (all.sums.empty()) return;
    float* sum = &all.sums[pixel * kFeatureChannels];
    const std::uint32_t surfel = projected_.shade[s.slot].surfel;
    for (const float f : cloud_.semantic_feature[surfel]) *sum++ += s.weight * f;
    for (const float f : cloud_.instance_feature[surfel]) *sum++ += s.weight * f;
    ++all.rows_read;
  }

  void fill(const ResolveJob& resolve, TileState& state) const {
    for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
      std::vector<std::uint32_t> keys;
      for (const WeightedSlot& s : stacks_[pixel]) {
        if (state.all != nullptr) take(s, pixel, *state.all);
        keys.push_back(make_key(s.weight, position_of(s.slot)));
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
                        .resolve = &resolve,
                        .selects = wants_candidates(resolve, channels),
                        .all_surfels = resolve.top_k == kAllSurfels,
                        .logs_labels = wants_labels(resolve, channels),
                        .sums_features = wants_features(resolve, channels)};
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
        state->keys[0][pixel] = make_key(weights[window], 5U);
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

}  // namespace
}  // namespace segsim::renderer::internal
