#include "experiments/detection/box_masks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "experiments/training/mask_quality.h"
#include "tests/error_message.h"

namespace segsim::experiments {
namespace {

using reconstruction::RoomPart;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(BoxMaskClasses, NamesKeepTheRecordingsIdsAndOthersFollow) {
  const std::vector<core::SceneClass> recorded{
      {1, "wall", false}, {4, "chair", true}, {9, "door", true}};
  const auto classes = detection::box_mask_classes({"tv", "chair"}, recorded, true, true);
  EXPECT_THAT(classes.of_class, ElementsAre(10, 4));
  EXPECT_EQ(classes.wall, 1);
  EXPECT_EQ(classes.floor, 11);
  EXPECT_EQ(classes.ceiling, 12);
  EXPECT_EQ(classes.other, 13);
  std::vector<std::uint16_t> ids;
  for (const auto& c : classes.table) ids.push_back(c.id);
  EXPECT_THAT(ids, ElementsAre(1, 4, 10, 11, 12, 13));  // No door: nothing finds it.
  const auto bare = detection::box_mask_classes({"tv"}, {}, false, false);
  EXPECT_EQ(bare.table.size(), 1U);
  EXPECT_EQ(bare.floor, 0);
  EXPECT_THAT(tests::input_error_of(
                  [] { (void)detection::box_mask_classes({"wall"}, {}, true, false); }),
              HasSubstr("--prompt"));
}

/// A mask of columns [from, to) of an 8 x 1 image.
core::Image<std::uint8_t> columns(int from, int to) {
  core::Image<std::uint8_t> mask(8, 1);
  for (int x = from; x < to; ++x) mask(x, 0) = 1;
  return mask;
}

TEST(PaintBoxMasks, ThingsLieOnTheRoomAndTheSurestOnTop) {
  const auto classes = detection::box_mask_classes({"chair", "bed"}, {}, true, true);
  core::Image<RoomPart> parts(8, 1, RoomPart::kNone);
  parts(0, 0) = RoomPart::kFloor;
  parts(1, 0) = RoomPart::kWall;
  core::Image<float> depth_m(8, 1, 2.0F);
  depth_m(7, 0) = std::numeric_limits<float>::quiet_NaN();
  const std::vector<core::Detection> found{{1, 0.4F, {}}, {0, 0.8F, {}}, {1, 0.6F, {}}};
  const auto view = detection::paint_box_masks(
      found, {columns(2, 5), columns(1, 4), columns(3, 6)}, parts, depth_m, classes, {});
  // The first bed is hidden by more than half: columns 2 and 3 under the chair, 4 under the
  // other bed.
  const std::uint16_t chair = classes.of_class[0], bed = classes.of_class[1];
  EXPECT_THAT(view.semantic.pixels(),
              ElementsAre(classes.floor, chair, chair, chair, bed, bed, classes.other, 0));
  EXPECT_THAT(view.instance.pixels(), ElementsAre(0, 1, 1, 1, 2, 2, 0, 0));
  EXPECT_THAT(view.confidence.pixels(), ElementsAre(204, 204, 204, 204, 153, 153, 51, 0));
  EXPECT_EQ(view.segments.size(), 4U);
}

TEST(PaintBoxMasks, WithoutOtherTheRestIsVoid) {
  const auto classes = detection::box_mask_classes({"chair"}, {}, true, false);
  const auto view = detection::paint_box_masks({}, {}, {8, 1, RoomPart::kNone},
                                               core::Image<float>(8, 1, 2.0F), classes, {});
  EXPECT_TRUE(view.segments.empty());
}

TEST(OpenDetector, NamesTheFlagThatIsWrong) {
  EXPECT_THAT(tests::input_error_of(
                  [] { (void)detection::open_detector("no.onnx", "", std::nullopt); }),
              AllOf(HasSubstr("--detector no.onnx"), HasSubstr("no such file")));
}

TEST(ClassTranslation, GoesByName) {
  const std::vector<core::SceneClass> from{
      {1, "other", false}, {2, "chair", true}, {3, "wall", false}},
      to{{1, "wall", false}, {2, "door", true}, {7, "chair", true}};
  const auto translation = training::translate_classes(from, to);
  core::Image<std::uint16_t> semantic(5, 1), instance(5, 1);
  semantic.pixels() = {1, 2, 3, 0, 900};
  instance.pixels() = {4, 5, 0, 0, 6};
  translation.apply(semantic, instance);
  EXPECT_THAT(semantic.pixels(), ElementsAre(0, 7, 1, 0, 0));
  EXPECT_THAT(instance.pixels(), ElementsAre(0, 5, 0, 0, 0));
  EXPECT_THAT(translation.common, ElementsAre("wall", "chair"));
  EXPECT_THAT(translation.unknown, ElementsAre("other"));
}

TEST(ClassRows, MeansAreOfTheNamedClassesThatOccur) {
  const std::vector<core::SceneClass> classes{
      {1, "wall", false}, {2, "chair", true}, {3, "bed", true}, {4, "door", true}};
  reconstruction::PanopticQuality quality;
  quality.classes = {{.class_id = 1, .counted = true, .iou_sum = 0.9, .true_positives = 1},
                     {.class_id = 2,
                      .thing = true,
                      .counted = true,
                      .iou_sum = 1.6,
                      .true_positives = 2,
                      .missed = 4},
                     {.class_id = 3, .thing = true},
                     {.class_id = 4, .thing = true, .counted = true, .missed = 3}};
  const auto rows = training::class_rows(quality, classes, {"wall", "chair", "bed"});
  ASSERT_EQ(rows.size(), 5U);
  EXPECT_EQ(rows[1].name, "chair");
  EXPECT_DOUBLE_EQ(rows[1].pq, 0.4);
  EXPECT_EQ(rows[2].name, "things");
  EXPECT_DOUBLE_EQ(rows[2].pq, 0.4);
  EXPECT_EQ(rows[4].name, "all");
  EXPECT_DOUBLE_EQ(rows[4].pq, 0.65);
  EXPECT_EQ(rows[4].missed, 4U);
}

}  // namespace
}  // namespace segsim::experiments
