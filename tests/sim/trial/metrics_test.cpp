#include "sim/trial/metrics.h"

#include <limits>

#include <gtest/gtest.h>

namespace segsim::sim {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(Spl, WorkedExamples) {
  EXPECT_NEAR(spl(true, 10, 12), 0.833333, 1e-6);
  EXPECT_DOUBLE_EQ(spl(true, 5, 5), 1.0);
  EXPECT_DOUBLE_EQ(spl(false, 8, 20), 0.0);
  EXPECT_DOUBLE_EQ(spl(true, 6, 3), 1.0);
  EXPECT_NEAR((spl(true, 10, 12) + spl(true, 5, 5) + spl(false, 8, 20) + spl(true, 6, 3)) / 4,
              0.708333, 1e-6);
}

TEST(Spl, EdgesGiveNumbers) {
  EXPECT_DOUBLE_EQ(spl(true, 0, 0), 1.0);
  EXPECT_DOUBLE_EQ(spl(true, 0, 2), 0.0);
  EXPECT_DOUBLE_EQ(spl(false, 0, 0), 0.0);
  EXPECT_DOUBLE_EQ(spl(false, kInfinity, 3), 0.0);
  EXPECT_DOUBLE_EQ(spl(true, kInfinity, 3), 0.0);
}

TEST(SoftSpl, WorkedExamples) {
  EXPECT_NEAR(soft_spl(2, 10, 12), 0.666667, 1e-6);
  EXPECT_DOUBLE_EQ(soft_spl(12, 10, 3), 0.0);
  EXPECT_NEAR(soft_spl(0.05, 8, 9), 0.883333, 1e-6);
}

TEST(SoftSpl, EdgesGiveNumbers) {
  EXPECT_DOUBLE_EQ(soft_spl(kInfinity, 5, 1), 0.0);
  EXPECT_DOUBLE_EQ(soft_spl(1, kInfinity, 1), 0.0);
  EXPECT_DOUBLE_EQ(soft_spl(0, 0, 0), 1.0);
  EXPECT_DOUBLE_EQ(soft_spl(1, 0, 1), 0.0);
}

}  // namespace
}  // namespace segsim::sim
