#include "reconstruction/evaluation/view_quality.h"

#include <vector>

#include <gtest/gtest.h>

namespace segsim::reconstruction {
namespace {

const std::vector<core::SceneClass> kClasses{{1, "floor", false}, {2, "chair", true}};

/// Keeps the list of a call readable.
std::vector<Overlap> cells(std::vector<Overlap> overlaps) { return overlaps; }

TEST(ViewQuality, PoolsClassesAndAveragesViews) {
  ContingencyTable table;
  // Floor 100/100 found, chair 1 found with IoU 0.4, chair 2 missed, one chair made up.
  table.add_overlaps(cells({{{1, 0}, {1, 0}, 100},
                            {{1, 0}, {2, 9}, 50},
                            {{2, 1}, {2, 4}, 40},
                            {{2, 1}, {0, 0}, 60},
                            {{2, 2}, {0, 0}, 50}}));
  // All found.
  table.add_overlaps(cells({{{1, 0}, {1, 0}, 100}, {{2, 7}, {2, 1}, 30}}));
  const ViewQuality quality = view_quality(table, kClasses);
  const double floor_iou = 100.0 / 150.0, sq = (floor_iou + 0.4) / 2.0;
  const double rq = 2.0 / (2.0 + 0.5 + 0.5);
  EXPECT_EQ(quality.views, 2U);
  EXPECT_NEAR(quality.sq, 0.5 * (sq + 1.0), 1e-12);
  EXPECT_NEAR(quality.rq, 0.5 * (rq + 1.0), 1e-12);
  EXPECT_NEAR(quality.pq, 0.5 * (sq * rq + 1.0), 1e-12);
  EXPECT_NEAR(quality.recall, 4.0 / 5.0, 1e-12);
  EXPECT_NEAR(quality.precision, 4.0 / 5.0, 1e-12);
  EXPECT_DOUBLE_EQ(quality.true_segments, 2.5);
  EXPECT_DOUBLE_EQ(quality.predicted_segments, 2.5);
  EXPECT_NEAR(quality.labelled_share, 0.5 * (190.0 / 300.0 + 1.0), 1e-12);
  EXPECT_NEAR(quality.mean_coverage, 0.5 * (0.5 * 0.4 + 1.0), 1e-12);
}

TEST(ViewQuality, MatchesOneToOneByDescendingIou) {
  ContingencyTable table;
  // Two predictions overlap one chair with 0.6 and 0.4: only the better one counts.
  table.add_overlaps(cells({{{2, 1}, {2, 4}, 60}, {{2, 1}, {2, 5}, 40}}));
  const ViewQuality quality = view_quality(table, kClasses);
  EXPECT_DOUBLE_EQ(quality.sq, 0.6);
  EXPECT_DOUBLE_EQ(quality.rq, 1.0 / 1.5);
}

TEST(ViewQuality, IgnoresSpecksAndPredictionsOnVoid) {
  ContingencyTable table;
  table.add_overlaps(cells({{{0, 0}, {2, 4}, 60},
                            {{1, 0}, {1, 0}, 100},
                            {{1, 0}, {2, 5}, 7},
                            {{2, 1}, {1, 0}, 24}}));
  const ViewQuality quality = view_quality(table, kClasses);
  EXPECT_DOUBLE_EQ(quality.rq, 1.0);
  EXPECT_DOUBLE_EQ(quality.precision, 1.0);
  EXPECT_DOUBLE_EQ(quality.true_segments, 1.0);
  // The same areas are no specks in a smaller image.
  EXPECT_LT(view_quality(table, kClasses, {.width_px = 160}).rq, 1.0);
}

TEST(ViewQuality, ForgivesMasksOfOverlookedObjects) {
  ContingencyTable table;
  table.add_overlaps(cells({{{1, 0}, {1, 0}, 100}, {{2, 1}, {2, 4}, 20}}));
  const ViewQuality quality = view_quality(table, kClasses);
  EXPECT_DOUBLE_EQ(quality.precision, 1.0);
  EXPECT_DOUBLE_EQ(quality.rq, 1.0);
  EXPECT_DOUBLE_EQ(quality.true_segments, 1.0);
}

TEST(ViewQuality, OfNothingIsZero) {
  ContingencyTable table;
  table.add_overlaps(cells({{{0, 0}, {0, 0}, 100}}));
  EXPECT_EQ(view_quality(table, kClasses).views, 0U);
  EXPECT_EQ(view_quality(table, kClasses).pq, 0.0);
}

}  // namespace
}  // namespace segsim::reconstruction
