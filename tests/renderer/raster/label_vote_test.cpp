#include "renderer/raster/label_vote.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include <hwy/targets.h>

#include "core/random.h"
#include "renderer/raster/tile_state.h"
#include "tests/renderer/make_key.h"

namespace segsim::renderer::internal {
namespace {

std::uint32_t random_index(core::RandomStream& random, std::size_t count) {
  return random.index(static_cast<std::uint32_t>(count));
}

float random_weight(core::RandomStream& random) {
  return static_cast<float>(std::exp(random.uniform(-8.0, 0.0)));
}

std::uint32_t label_of(std::uint32_t semantic, std::uint32_t instance) {
  return semantic | instance << 16U;
}

/// Heaviest value of a half of the labels, by a map of doubles.
std::pair<std::uint16_t, double> oracle_winner(const std::vector<WeightedLabel>& candidates,
                                               unsigned shift) {
  std::map<std::uint16_t, double> sums;
  double total = 0.0;
  for (const WeightedLabel& c : candidates) {
    sums[static_cast<std::uint16_t>(c.label >> shift)] += static_cast<double>(c.weight);
    total += static_cast<double>(c.weight);
  }
  const auto best =
      std::max_element(sums.begin(), sums.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  return {best->first, best->second / total};
}

TEST(Vote, HeaviestSumWinsForAnyNumberOfSurfels) {
  core::RandomStream random(1, "vote");
  for (const int count : {1, 2, 3, 4, 8, 24, 25, 300, 3000}) {
    for (int repeat = 0; repeat < 50; ++repeat) {
      std::vector<WeightedLabel> candidates;
      for (int i = 0; i < count; ++i) {
        const auto semantic = random_index(random, 5);
        const auto instance = random_index(random, 9);
        candidates.push_back({random_weight(random), label_of(semantic, instance)});
      }
      const PixelLabel label = vote(candidates);
      const auto [semantic, share] = oracle_winner(candidates, 0);
      const auto [instance, instance_share] = oracle_winner(candidates, 16);
      EXPECT_EQ(label.semantic, semantic);
      EXPECT_EQ(label.instance, instance);
      EXPECT_NEAR(static_cast<double>(label.confidence), share, 1e-6);
      EXPECT_NEAR(static_cast<double>(label.instance_confidence), instance_share, 1e-6);
    }
  }
}

TEST(Vote, ClassAndInstanceAreCountedApartAndTiesGoToTheLowerId) {
  const std::vector<WeightedLabel> candidates = {
      {0.25F, label_of(9, 2)}, {0.125F, label_of(4, 7)}, {0.125F, label_of(4, 1)}};
  const PixelLabel label = vote(candidates);
  EXPECT_EQ(label.semantic, 4);
  EXPECT_EQ(label.instance, 2);
  EXPECT_FLOAT_EQ(label.confidence, 0.5F);
  EXPECT_FLOAT_EQ(label.instance_confidence, 0.5F);
  EXPECT_EQ(vote({}).semantic, 0);
  EXPECT_EQ(vote({}).confidence, 0.0F);
}

/// Keys of 16 or more pixels, as the blend loop leaves them: heaviest first, then keys that
/// have a position but no weight.
struct RandomKeys {
  static constexpr std::size_t kPixels = 64;
  std::vector<std::uint32_t> planes;
  std::vector<std::uint32_t> slots;
  std::vector<SurfelShade> shade;

  RandomKeys(std::uint64_t seed, int key_count, std::uint32_t labels)
      : planes(kPixels * static_cast<std::size_t>(key_count)), slots(200), shade(900) {
    core::RandomStream random(seed, "keys");
    for (SurfelShade& s : shade) {
      s.label = label_of(random_index(random, labels) * 13000U,
                         random_index(random, labels) * 9000U);
    }
    for (std::uint32_t& s : slots) s = random_index(random, shade.size());
    for (std::size_t pixel = 0; pixel < kPixels; ++pixel) {
      std::vector<std::uint32_t> keys(static_cast<std::size_t>(key_count));
      const std::size_t real = random_index(random, keys.size() + 1);
      for (std::size_t k = 0; k < keys.size(); ++k) {
        const auto position = random_index(random, slots.size());
        const float weight = random_weight(random);
        keys[k] = make_key(k < real ? weight : 0.0F, position);
      }
      std::sort(keys.rbegin(), keys.rend());
      for (std::size_t k = 0; k < keys.size(); ++k) planes[k * kPixels + pixel] = keys[k];
    }
  }

  [[nodiscard]] std::vector<WeightedLabel> candidates(std::size_t pixel, int key_count) const {
    std::vector<WeightedLabel> found;
    for (std::size_t k = 0; k < static_cast<std::size_t>(key_count); ++k) {
      const std::uint32_t key = planes[k * kPixels + pixel];
      if (!is_key(key)) break;
      found.push_back({key_weight(key), shade[slots[key_position(key)]].label});
    }
    return found;
  }
};

void expect_rows_equal_votes() {
  std::uint64_t seed = 0;
  for (const int key_count : {1, 2, 3, 4, 5, 8, 16, 24}) {
    for (const std::uint32_t labels : {1U, 2U, 5U}) {
      const RandomKeys keys(++seed, key_count, labels);
      std::array<std::uint16_t, RandomKeys::kPixels> semantic{}, instance{};
      std::array<float, RandomKeys::kPixels> confidence{}, instance_confidence{};
      const std::uint64_t read = vote_row(
          {keys.planes.data(), RandomKeys::kPixels, key_count, RandomKeys::kPixels},
          keys.slots.data(), keys.shade.data(),
          {semantic.data(), instance.data(), confidence.data(), instance_confidence.data()});
      std::uint64_t expected_read = 0;
      for (std::size_t pixel = 0; pixel < semantic.size(); ++pixel) {
        const std::vector<WeightedLabel> candidates = keys.candidates(pixel, key_count);
        const PixelLabel expected = vote(candidates);
        expected_read += candidates.size();
        EXPECT_EQ(semantic[pixel], expected.semantic);
        EXPECT_EQ(instance[pixel], expected.instance);
        EXPECT_NEAR(confidence[pixel], expected.confidence, 1e-6F);
        EXPECT_NEAR(instance_confidence[pixel], expected.instance_confidence, 1e-6F);
      }
      EXPECT_EQ(read, expected_read);
    }
  }
}

TEST(Vote, RowsEqualPixelsOnEveryInstructionSet) {
  int tested = 0;
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    expect_rows_equal_votes();
    ++tested;
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  EXPECT_GE(tested, 2);
}

}  // namespace
}  // namespace segsim::renderer::internal
