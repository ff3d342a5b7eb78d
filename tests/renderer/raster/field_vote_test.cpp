// Labels of pixels whose surfels agree are those of the general rule, to the bit.
#include "renderer/raster/field_vote.h"

#include <algorithm>
#include <array>

#include <gtest/gtest.h>

#include "renderer/raster/selection_key.h"
#include "renderer/raster/tile_state.h"
#include "tests/renderer/make_key.h"
#include "tests/renderer/raster/panoptic_fixture.h"

namespace segsim::renderer::internal {
namespace {

using renderer::testing::Panoptic;
using renderer::testing::random_index;
using renderer::testing::random_weight;

constexpr int kTopK = 4;

/// A tile whose pixels select neighbouring surfels, as real ones do: many agree.
class FieldVote : public Panoptic {
 protected:
  /// Labels of all pixels of a random tile, each compared with resolve_panoptic().
  void compare(const PanopticField& field, std::uint64_t seed) {
    core::RandomStream random(seed, "tile");
    const FieldTops tops(field);
    std::vector<SurfelShade> shade(cloud_.size());
    std::vector<std::uint32_t> slots(cloud_.size());
    for (std::uint32_t s = 0; s < shade.size(); ++s) {
      shade[s].surfel = s;
      shade[s].label = tops.labels()[s];
      slots[s] = s;
    }
    std::array<std::array<std::uint32_t, kTilePixels>, kTopK> keys{};
    for (std::size_t p = 0; p < kTilePixels; ++p) {
      const std::uint32_t first = random_index(random, cloud_.size());
      std::vector<std::uint32_t> of_pixel;
      for (std::uint32_t k = random_index(random, kTopK + 1); k > 0; --k) {
        // Mostly one surfel, so that pixels agree.
        const std::uint32_t s =
            random_index(random, 8) == 0 ? random_index(random, cloud_.size()) : first;
        of_pixel.push_back(make_key(random_weight(random) * 0.9F, s));
      }
      std::sort(of_pixel.rbegin(), of_pixel.rend());
      for (std::size_t k = 0; k < of_pixel.size(); ++k) keys[k][p] = of_pixel[k];
    }
    struct {
      std::array<std::uint16_t, kTilePixels> semantic, instance;
      std::array<float, kTilePixels> confidence, instance_confidence;
    } out;
    PixelSet left;
    const KeyRow row{keys[0].data(), kTilePixels, kTopK, static_cast<int>(kTilePixels)};
    (void)vote_field(row, slots.data(), shade.data(), tops,
                     {out.semantic.data(), out.instance.data(), out.confidence.data(),
                      out.instance_confidence.data()},
                     left);
    ResolveScratch scratch;
    for (std::size_t p = 0; p < kTilePixels; ++p) {
      std::vector<WeightedSurfel> selected;
      std::vector<std::uint32_t> labels;
      for (int k = 0; k < kTopK && is_key(keys[k][p]); ++k) {
        const std::uint32_t slot = slots[key_position(keys[k][p])];
        selected.push_back({key_weight(keys[k][p]), slot});
        labels.push_back(tops.labels()[slot]);
      }
      const bool agree = std::all_of(labels.begin(), labels.end(), [&](std::uint32_t label) {
        return label == labels[0] && label != FieldTops::kUndecided;
      });
      ASSERT_EQ((left[p / 64] >> p % 64 & 1U) == 0, agree) << p;
      if (!agree) {
        ++undecided_;
        continue;
      }
      const PixelLabel label = resolve_panoptic(field, selected, scratch);
      ASSERT_EQ(out.semantic[p], label.semantic) << p;
      ASSERT_EQ(out.instance[p], label.instance) << p;
      ASSERT_EQ(out.confidence[p], label.confidence) << p;
      ASSERT_EQ(out.instance_confidence[p], label.instance_confidence) << p;
      empty_ += selected.empty() ? 1 : 0;
      things_ += label.instance != 0 ? 1 : 0;
      stuff_ += !selected.empty() && label.instance == 0 ? 1 : 0;
    }
  }

  int undecided_ = 0, empty_ = 0, things_ = 0, stuff_ = 0;
};

TEST_F(FieldVote, EqualsTheGeneralRule) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) compare(field_, seed);
  for (const int count : {undecided_, empty_, things_, stuff_}) EXPECT_GT(count, 50);
}

TEST_F(FieldVote, EqualsTheGeneralRuleWhereQueriesHaveClassesAndRowsAreShort) {
  for (PanopticClass& c : model_.classes) c.thing = c.id != 0;
  model_.variant = LabelVariant::kNormalised;
  PanopticField field =
      fold_panoptic_model(cloud_, model_, {.max_classes = 2, .max_instances = 2});
  field.instance_class.assign(field.instance_id.size(), 0);
  for (std::size_t q = 0; q < model_.queries.size(); q += 2) {
    field.instance_class[q] = model_.classes[5].id;
  }
  for (std::uint64_t seed = 0; seed < 8; ++seed) compare(field, seed);
  for (const int count : {undecided_, empty_, things_, stuff_}) EXPECT_GT(count, 20);
}

}  // namespace
}  // namespace segsim::renderer::internal
