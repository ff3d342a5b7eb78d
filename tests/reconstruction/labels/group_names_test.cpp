#include "reconstruction/labels/internal/group_names.h"

#include <gtest/gtest.h>

namespace segsim::reconstruction::internal {
namespace {

constexpr std::int64_t kFloor = 0, kChair = 1, kTable = 2;
const std::vector<core::SceneClass> kClasses{
    {1, "floor", false}, {3, "chair", true}, {4, "table", true}};

class GroupNames : public ::testing::Test {
 protected:
  void add(std::int64_t frame, std::int64_t group, std::int64_t class_index,
           std::int64_t mask_id, int count, float feature = 0.5F) {
    for (int i = 0; i < count; ++i) {
      pixels_.frame.push_back(frame);
      pixels_.group.push_back(group);
      pixels_.class_index.push_back(class_index);
      pixels_.mask_id.push_back(mask_id);
      pixels_.feature.push_back(feature);
    }
  }
  [[nodiscard]] std::vector<GroupName> names() const {
    return name_groups(pixels_, group_feature_, group_feature_.size(), kClasses, options_);
  }

  GroupedPixels pixels_;
  std::vector<float> group_feature_{0.5F, 0.5F, 0.5F};
  GroupNamingOptions options_;
};

TEST_F(GroupNames, GroupsOfOneMaskAreOneObjectInAnyOrderOfIds) {
  for (const std::int64_t frame : {0, 1, 2}) {
    add(frame, 0, kChair, 7 + frame, 30);
    add(frame, 1, kChair, 7 + frame, 30);
    add(frame, 2, kChair, 20 - frame, 30);
  }
  EXPECT_EQ(names(), (std::vector<GroupName>{{kChair, 1}, {kChair, 1}, {kChair, 2}}));
}

TEST_F(GroupNames, MostViewsThatShowBothDecide) {
  for (const std::int64_t frame : {0, 1, 2}) {
    add(frame, 0, kChair, 1, 30);
    add(frame, 1, kChair, frame == 0 ? 1 : 2, 30);  // One mask in a third of the views.
  }
  EXPECT_EQ(names()[1].object, 2);
  options_.min_together = 0.3;
  EXPECT_EQ(names()[1].object, 1);
}

TEST_F(GroupNames, OtherClassesAreOtherObjects) {
  add(0, 0, kChair, 1, 30);
  add(0, 1, kTable, 2, 30);
  add(0, 1, kChair, 1, 1);
  add(0, 2, kFloor, 0, 30);
  EXPECT_EQ(names(), (std::vector<GroupName>{{kChair, 1}, {kTable, 2}, {kFloor, 0}}));
}

TEST_F(GroupNames, TheMaskThatFitsNamesTheGroupNotMostOfItsPixels) {
  add(0, 0, kTable, 1, 40);  // A table whose mask is far larger than the group, ...
  add(0, 1, kTable, 1, 400);
  for (const std::int64_t frame : {1, 2}) add(frame, 0, kChair, 5, 15);  // ... and chairs.
  EXPECT_EQ(names()[0].class_index, kChair);
  options_.min_score = 1.0;  // No mask fits: pixels decide.
  EXPECT_EQ(names()[0].class_index, kTable);
}

TEST_F(GroupNames, MasksThatLookDifferentDoNotFit) {
  for (const std::int64_t frame : {0, 1}) add(frame, 0, kChair, 1, 30, 0.5F);
  for (const std::int64_t frame : {2, 3, 4}) add(frame, 0, kTable, 1, 5, 1.35F);
  EXPECT_EQ(names()[0].class_index, kChair);  // IoU 1, likeness 0.15.
}

TEST_F(GroupNames, WhatNoPixelShowsHasNoName) {
  add(0, 0, kChair, 1, 30);
  EXPECT_EQ(names()[2], (GroupName{-1, 0}));
}

}  // namespace
}  // namespace segsim::reconstruction::internal
