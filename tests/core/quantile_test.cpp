#include "core/quantile.h"

#include <gtest/gtest.h>

namespace segsim::core {
namespace {

TEST(Quantile, IsAValueThatOccurs) {
  const std::vector<int> values{40, 10, 30, 20};  // At shares 1, 0, 2/3, 1/3.
  for (const Between between : {Between::kLower, Between::kNearest}) {
    EXPECT_EQ(quantile(values, 0.0, between), 10);
    EXPECT_EQ(quantile(values, 1.0, between), 40);
    EXPECT_EQ(quantile(std::vector<int>{7}, 0.3, between), 7);
  }
  EXPECT_EQ(quantile(values, 0.6, Between::kLower), 20);    // 1.8 steps from the first.
  EXPECT_EQ(quantile(values, 0.6, Between::kNearest), 30);  // The nearest is the second.
  EXPECT_EQ(quantile(values, 0.4, Between::kNearest), 20);
  EXPECT_EQ(quantile(values, 0.5, Between::kNearest), 30) << "halves go up";
}

TEST(Quantile, Interpolates) {
  EXPECT_DOUBLE_EQ(interpolated_quantile({4, 1, 3, 2}, 0.5), 2.5);
  EXPECT_DOUBLE_EQ(interpolated_quantile({4, 1, 3, 2}, 0.0), 1.0);
  EXPECT_DOUBLE_EQ(interpolated_quantile({4, 1, 3, 2}, 1.0), 4.0);
  EXPECT_DOUBLE_EQ(interpolated_quantile({7}, 0.99), 7.0);
}

TEST(Quantile, RefusesNothingAndSharesOutside) {
  EXPECT_THROW((void)quantile(std::vector<float>{}, 0.5, Between::kLower), ContractViolation);
  EXPECT_THROW((void)quantile(std::vector<float>{1.0F}, 1.01, Between::kLower),
               ContractViolation);
  EXPECT_THROW((void)interpolated_quantile({}, 0.5), ContractViolation);
}

}  // namespace
}  // namespace segsim::core
