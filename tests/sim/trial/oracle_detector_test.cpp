#include "sim/trial/oracle_detector.h"

#include <gtest/gtest.h>

#include "core/check.h"

namespace segsim::sim {
namespace {

const std::vector<core::SceneClass> kClasses = {
    {1, "wall", false}, {4, "couch", true}, {7, "chair", true}, {9, "tv", true}};

/// A 64 x 48 frame with a wall and labelled rectangles.
core::Frame blank_frame() {
  core::Frame frame;
  frame.semantic = core::Image<std::uint16_t>(64, 48, 1);
  frame.instance = core::Image<std::uint16_t>(64, 48, 0);
  return frame;
}

void paint(core::Frame& frame, int x0, int y0, int x1, int y1, std::uint16_t class_id,
           std::uint16_t instance) {
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x) {
      frame.semantic(x, y) = class_id;
      frame.instance(x, y) = instance;
    }
  }
}

core::Observation capture(std::uint64_t index) {
  core::Observation observation;
  observation.capture_index = index;
  return observation;
}

TEST(OracleDetector, TightBoxesOfListedClasses) {
  core::Frame frame = blank_frame();
  paint(frame, 10, 5, 20, 15, 7, 12);
  paint(frame, 40, 30, 64, 48, 4, 3);
  paint(frame, 0, 40, 20, 48, 9, 5);  // A tv: not asked for.
  paint(frame, 30, 0, 33, 3, 7, 13);  // 9 pixels: too small.
  paint(frame, 12, 7, 14, 9, 1, 0);   // A hole does not matter.
  OracleDetector detector(kClasses, {"chair", "couch", "unicorn"}, {.min_pixels = 10});
  EXPECT_TRUE(detector.detect(capture(0)).empty()) << "nothing was shown yet";
  detector.set_truth(frame);
  const auto found = detector.detect(capture(0));
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].class_index, 1);  // Instance 3, the couch.
  EXPECT_EQ(found[0].score, 1.0F);
  EXPECT_EQ(found[0].box.x0, 40.0F);
  EXPECT_EQ(found[0].box.y1, 48.0F);
  EXPECT_EQ(found[1].class_index, 0);
  EXPECT_EQ(found[1].box.x0, 10.0F);
  EXPECT_EQ(found[1].box.y0, 5.0F);
  EXPECT_EQ(found[1].box.x1, 20.0F);
  EXPECT_EQ(found[1].box.y1, 15.0F);
}

TEST(OracleDetector, APhraseLeavesOutOtherThingsOfItsClass) {
  core::Frame frame = blank_frame();
  paint(frame, 0, 0, 20, 20, 7, 12);
  paint(frame, 30, 0, 50, 20, 7, 13);
  paint(frame, 0, 30, 20, 48, 4, 3);
  OracleDetector detector(kClasses, {"chair", "couch"});
  Episode episode;
  episode.class_name = "chair";
  episode.phrase = "a red chair";
  episode.goal_instances = {13};
  detector.begin_episode(episode);
  detector.set_truth(frame);
  const auto found = detector.detect(capture(0));
  ASSERT_EQ(found.size(), 2U) << "the couch is of another class";
  EXPECT_EQ(found[0].class_index, 1);
  EXPECT_EQ(found[1].class_index, 0);
  EXPECT_EQ(found[1].box.x0, 30.0F);
  detector.begin_episode({});
  EXPECT_EQ(detector.detect(capture(0)).size(), 3U);
}

TEST(OracleDetector, RecallIsAFrequencyAndRepeats) {
  core::Frame frame = blank_frame();
  paint(frame, 10, 5, 20, 15, 7, 12);
  paint(frame, 30, 5, 40, 15, 7, 14);
  OracleDetector a(kClasses, {"chair"}, {.recall = 0.7, .seed = 5});
  OracleDetector b(kClasses, {"chair"}, {.recall = 0.7, .seed = 5});
  a.set_truth(frame);
  b.set_truth(frame);
  int total = 0;
  for (std::uint64_t k = 0; k < 2000; ++k) {
    const auto found = a.detect(capture(k));
    total += static_cast<int>(found.size());
    EXPECT_EQ(found.size(), b.detect(capture(k)).size());
  }
  EXPECT_NEAR(total / 4000.0, 0.7, 0.03);
}

TEST(OracleDetector, DrawsDoNotDependOnWhatElseIsInView) {
  core::Frame alone = blank_frame();
  paint(alone, 10, 5, 30, 25, 7, 12);
  core::Frame crowd = alone;
  paint(crowd, 40, 5, 60, 25, 7, 2);
  OracleDetector detector(kClasses, {"chair"}, {.jitter_share = 0.1, .seed = 3});
  detector.set_truth(alone);
  const auto one = detector.detect(capture(8));
  detector.set_truth(crowd);
  const auto two = detector.detect(capture(8));
  ASSERT_EQ(one.size(), 1U);
  ASSERT_EQ(two.size(), 2U);
  EXPECT_EQ(one[0].box.x0, two[1].box.x0);
  EXPECT_NE(one[0].box.x0, 10.0F) << "shaken";
  EXPECT_GE(core::iou(one[0].box, {10, 5, 30, 25}), 0.5F);
}

TEST(OracleDetector, RefusesAFrameWithoutLabels) {
  OracleDetector detector(kClasses, {"chair"});
  EXPECT_THROW(detector.set_truth(core::Frame{}), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::sim
