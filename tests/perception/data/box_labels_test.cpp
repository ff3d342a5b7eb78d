#include "perception/data/box_labels.h"

#include <limits>
#include <map>
#include <optional>
#include <utility>

#include <gmock/gmock.h>

#include "core/check.h"

namespace segsim::perception {
namespace {

const std::vector<core::SceneClass> kScene = {
    {3, "chair", true}, {5, "wall", false}, {7, "couch", true}};
const std::vector<std::string> kNames = {"couch", "chair"};

/// LabelView::visible_fraction from a table; whoever is missing has none.
auto fractions(std::map<std::uint16_t, double> of_instance) {
  return [of_instance = std::move(of_instance)](std::uint16_t id) -> std::optional<double> {
    const auto found = of_instance.find(id);
    return found == of_instance.end() ? std::nullopt : std::optional(found->second);
  };
}

/// 100 x 80 labels.
struct Labels {
  core::Image<std::uint16_t> semantic{100, 80}, instance{100, 80};
  LabelView view{&semantic, &instance, nullptr, {}};

  void fill(int x0, int y0, int x1, int y1, std::uint16_t class_id, std::uint16_t id) {
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) {
        semantic(x, y) = class_id;
        instance(x, y) = id;
      }
    }
  }
  [[nodiscard]] std::vector<LabeledBox> label(const BoxLabelOptions& options = {}) const {
    return label_boxes(view, kScene, kNames, options);
  }
};

TEST(BoxLabels, BoxIsTightAndHalfOpen) {
  Labels labels;
  labels.fill(10, 20, 22, 33, 3, 9);
  labels.fill(50, 0, 100, 80, 5, 0);   // Wall: no instance.
  labels.fill(40, 40, 48, 48, 5, 11);  // An instance of a class that nobody asked for.
  labels.fill(0, 60, 30, 80, 7, 4);
  const auto boxes = labels.label();
  ASSERT_EQ(boxes.size(), 2U);
  EXPECT_EQ(boxes[0].class_index, 0);  // Instance 4 comes first.
  EXPECT_EQ(boxes[1].class_index, 1);
  EXPECT_EQ(boxes[1].box.x0, 10);
  EXPECT_EQ(boxes[1].box.y0, 20);
  EXPECT_EQ(boxes[1].box.x1, 22);
  EXPECT_EQ(boxes[1].box.y1, 33);
  EXPECT_EQ(boxes[1].area_px2, 12 * 13);
  EXPECT_FALSE(boxes[1].ignore);
}

TEST(BoxLabels, StrayPixelsAreCutOff) {
  Labels labels;
  labels.fill(20, 20, 60, 60, 3, 1);  // 1600 pixels: 8 may go at each side.
  labels.fill(60, 40, 66, 41, 3, 1);  // A bleeding edge of 6.
  const auto boxes = labels.label();
  ASSERT_EQ(boxes.size(), 1U);
  EXPECT_EQ(boxes[0].box.x1, 60);
  EXPECT_EQ(boxes[0].box.x0, 20);
  EXPECT_EQ(labels.label({.quantile = 0.0})[0].box.x1, 66);
}

TEST(BoxLabels, FarComponentsAreDroppedAndNearOnesKept) {
  Labels labels;
  labels.fill(10, 10, 30, 30, 3, 1);
  labels.fill(34, 10, 44, 30, 3, 1);  // 4 px away: the same chair behind a leg.
  labels.fill(85, 70, 95, 78, 3, 1);  // Farther than half of the longer side.
  const auto boxes = labels.label();
  ASSERT_EQ(boxes.size(), 1U);
  EXPECT_EQ(boxes[0].box.x0, 10);
  EXPECT_EQ(boxes[0].box.x1, 44);
  EXPECT_EQ(boxes[0].box.y1, 30);
  EXPECT_EQ(boxes[0].area_px2, 400 + 200);
}

TEST(BoxLabels, FlagsSayWhatIsCutOffOrHidden) {
  Labels labels;
  labels.fill(0, 20, 20, 40, 3, 1);   // Touches the left border.
  labels.fill(30, 20, 50, 40, 3, 2);  // Whole.
  labels.fill(60, 60, 80, 80, 3, 3);  // Touches the lower border; half hidden.
  core::Image<float> depth_m(100, 80, 4.0F);
  for (int x = 30; x < 38; ++x) depth_m(x, 30) = 1.0F;  // A few nearer pixels.
  labels.view.depth_m = &depth_m;
  labels.view.visible_fraction = fractions({{2, 0.95}, {3, 0.5}});
  const auto boxes = labels.label();
  ASSERT_EQ(boxes.size(), 3U);
  EXPECT_TRUE(boxes[0].truncated);
  EXPECT_FALSE(boxes[0].occluded);
  EXPECT_FALSE(boxes[1].truncated);
  EXPECT_FALSE(boxes[1].occluded);
  EXPECT_TRUE(boxes[2].truncated);
  EXPECT_TRUE(boxes[2].occluded);
  EXPECT_EQ(boxes[1].instance_id, 2);
  EXPECT_EQ(boxes[1].distance_m, 4.0);
}

TEST(BoxLabels, SmallOrHiddenObjectsAreIgnoredNotDropped) {
  Labels labels;
  labels.fill(0, 0, 2, 2, 3, 1);  // 4 px < 0.0006 * 8000.
  labels.fill(10, 10, 30, 30, 3, 2);
  labels.fill(40, 10, 60, 30, 3, 3);
  std::vector<std::uint16_t> asked;
  labels.fill(70, 10, 90, 30, 5, 4);  // A wall gets no label.
  labels.view.visible_fraction = [&, of_instance =
                                         fractions({{2, 0.1}, {3, 0.4}})](std::uint16_t id) {
    asked.push_back(id);
    return of_instance(id);
  };
  const auto boxes = labels.label();
  ASSERT_EQ(boxes.size(), 3U);
  EXPECT_TRUE(boxes[0].ignore);
  EXPECT_THAT(asked, testing::ElementsAre(1, 2, 3));
  EXPECT_FALSE(boxes[0].visible_fraction.has_value());
  EXPECT_TRUE(boxes[1].ignore);
  EXPECT_FALSE(boxes[2].ignore);
  EXPECT_EQ(boxes[2].visible_fraction, 0.4);
}

TEST(BoxLabels, HolesInTheDepthAreIgnored) {
  Labels labels;
  labels.fill(10, 10, 30, 30, 3, 1);
  core::Image<float> depth(100, 80, 2.0F);
  labels.view.depth_m = &depth;
  EXPECT_FALSE(labels.label()[0].ignore);
  for (int y = 10; y < 21; ++y) {  // 11 of 20 rows.
    for (int x = 10; x < 30; ++x) depth(x, y) = std::numeric_limits<float>::quiet_NaN();
  }
  EXPECT_TRUE(labels.label()[0].ignore);
}

TEST(BoxLabels, ClassIsTheMajorityWithoutVoid) {
  Labels labels;
  labels.fill(10, 10, 30, 30, 0, 1);
  labels.fill(10, 10, 14, 30, 7, 1);
  labels.fill(14, 10, 16, 30, 3, 1);
  const auto boxes = labels.label();
  ASSERT_EQ(boxes.size(), 1U);
  EXPECT_EQ(boxes[0].class_index, 0);
  EXPECT_EQ(boxes[0].box.x1, 30);
}

TEST(BoxLabels, EmptyViewHasNone) { EXPECT_TRUE(Labels().label().empty()); }

TEST(BoxLabels, SizesMustAgree) {
  Labels labels;
  const core::Image<float> depth(10, 10);
  labels.view.depth_m = &depth;
  EXPECT_THROW((void)labels.label(), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::perception
