#include "perception/evaluation/confusion.h"

#include <gtest/gtest.h>

namespace segsim::perception {
namespace {

using core::BoxPx;

LabeledBox object(int class_index, const BoxPx& box, bool ignore = false) {
  LabeledBox label;
  label.class_index = class_index;
  label.box = box;
  label.ignore = ignore;
  return label;
}

const BoxPx kA{0, 0, 10, 10}, kB{20, 0, 30, 10}, kC{40, 0, 50, 10}, kD{60, 0, 70, 10};

TEST(Confusion, EveryKindOfErrorIsCountedOnce) {
  const std::vector<ImageResult> images{
      {{object(0, kA), object(1, kB), object(0, kC), object(1, kD, true)},
       {{0, 0.9F, kA},               // Right.
        {0, 0.8F, kB},               // A 1 taken for a 0.
        {1, 0.7F, {80, 0, 90, 10}},  // Nothing there.
        {1, 0.6F, kD},               // On an ignored object: neither right nor wrong.
        {0, 0.2F, kC}}}};            // Below the threshold: kC is missed.
  const ConfusionMatrix m = confusion_matrix(images, 2, 0.5);
  EXPECT_EQ(m.at(0, 0), 1);
  EXPECT_EQ(m.at(1, 0), 1);
  EXPECT_EQ(m.at(2, 1), 1);
  EXPECT_EQ(m.at(0, 2), 1);
  int sum = 0;
  for (const int count : m.counts) sum += count;
  EXPECT_EQ(sum, 4);
  ASSERT_EQ(m.misses.size(), 3U);
  EXPECT_EQ(m.misses[0].kind, MissKind::kWrongClass);
  EXPECT_EQ(m.misses[0].truth, 1);
  EXPECT_EQ(m.misses[0].detection, 1);
  EXPECT_EQ(m.misses[1].kind, MissKind::kMissed);
  EXPECT_EQ(m.misses[1].truth, 2);
  EXPECT_EQ(m.misses[2].kind, MissKind::kBackground);
  EXPECT_EQ(m.misses[2].detection, 2);
}

TEST(Confusion, TheSameClassComesBeforeGreaterOverlap) {
  // The wrong class fits perfectly, the right one by 0.8: the right one is paired.
  const std::vector<ImageResult> images{
      {{object(0, kA)}, {{1, 0.9F, kA}, {0, 0.6F, {0, 0, 10, 8}}}}};
  const ConfusionMatrix m = confusion_matrix(images, 2, 0.5);
  EXPECT_EQ(m.at(0, 0), 1);
  EXPECT_EQ(m.at(2, 1), 1);  // The other detection has no object left.
  EXPECT_EQ(m.at(0, 1), 0);
}

TEST(Confusion, RowsSumToTheObjectsAndColumnsToTheDetections) {
  const std::vector<ImageResult> images{
      {{object(0, kA), object(0, kB)}, {{0, 0.9F, kA}, {0, 0.9F, kA}, {1, 0.9F, kB}}},
      {{object(1, kC)}, {}},
      {{}, {{1, 0.7F, kD}}}};
  const ConfusionMatrix m = confusion_matrix(images, 2, 0.5);
  EXPECT_EQ(m.at(0, 0) + m.at(0, 1) + m.at(0, 2), 2);
  EXPECT_EQ(m.at(1, 0) + m.at(1, 1) + m.at(1, 2), 1);
  EXPECT_EQ(m.at(0, 0) + m.at(1, 0) + m.at(2, 0), 2);
  EXPECT_EQ(m.at(0, 1) + m.at(1, 1) + m.at(2, 1), 2);
}

}  // namespace
}  // namespace segsim::perception
