#include "experiments/detection/open_vocabulary_masks.h"

#include <gtest/gtest.h>

#include "core/error.h"

namespace segsim::experiments {
namespace {

/// A mask of columns [from, to) of an 8 x 2 image.
perception::PromptMask columns(int from, int to) {
  perception::PromptMask mask;
  mask.inside = core::Image<std::uint8_t>(8, 2);
  for (int y = 0; y < 2; ++y) {
    for (int x = from; x < to; ++x) mask.inside(x, y) = 1;
  }
  return mask;
}

TEST(OpenVocabularyMasks, TheSurestIsOnTop) {
  const std::vector<core::SceneClass> classes{{4, "chair", true}, {9, "wall", false}};
  const std::vector<core::Detection> found{
      {1, 0.4F, {}}, {0, 0.6F, {}}, {0, 0.8F, {}}, {1, 0.2F, {}}, {0, 0.1F, {}}};
  const auto masks = detection::compose_masks(
      8, 2, found, {columns(0, 4), columns(2, 6), columns(5, 7), columns(7, 8), columns(0, 3)},
      classes);
  const std::uint16_t semantic[8] = {9, 9, 4, 4, 4, 4, 4, 9};
  const std::uint16_t instance[8] = {0, 0, 2, 2, 2, 1, 1, 0};
  const std::uint8_t confidence[8] = {102, 102, 153, 153, 153, 204, 204, 51};
  for (int x = 0; x < 8; ++x) {
    EXPECT_EQ(masks.semantic(x, 1), semantic[x]) << x;
    EXPECT_EQ(masks.instance(x, 1), instance[x]) << x;
    EXPECT_EQ(masks.confidence(x, 1), confidence[x]) << x;
  }
  ASSERT_EQ(masks.segments.size(), 3U);  // The chair under the walls has no pixel left.
  EXPECT_EQ(masks.segments[0].class_id, 9);
  EXPECT_EQ(masks.segments[0].area_px, 6);
}

TEST(OpenVocabularyMasks, NothingFoundIsVoid) {
  const auto masks = detection::compose_masks(8, 2, {}, {}, {});
  EXPECT_TRUE(masks.segments.empty());
  EXPECT_EQ(masks.semantic(0, 0), 0);
}

TEST(OpenVocabularyMasks, PhrasesTakeTheClassesOfTheRecording) {
  const std::vector<core::SceneClass> recorded{{3, "wall", false}, {7, "chair", true}};
  const auto known = detection::prompt_classes({"chair", "wall"}, {}, recorded, "--prompt");
  EXPECT_EQ(known[0].id, 7);
  EXPECT_FALSE(known[1].thing);
  const auto fresh = detection::prompt_classes({"lamp", "floor"}, {"floor"}, {}, "--prompt");
  EXPECT_EQ(fresh[1].id, 2);
  EXPECT_TRUE(fresh[0].thing);
  EXPECT_FALSE(fresh[1].thing);
  EXPECT_THROW((void)detection::prompt_classes({"lamp"}, {}, recorded, "--prompt"),
               core::InputError);
  EXPECT_THROW((void)detection::prompt_classes({"lamp"}, {"wall"}, {}, "--prompt"),
               core::InputError);
}

}  // namespace
}  // namespace segsim::experiments
