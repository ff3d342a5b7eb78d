#include "reconstruction/labels/internal/class_logits.h"

#include <gtest/gtest.h>

namespace segsim::reconstruction::internal {
namespace {

Tensor table(std::vector<float> values, std::int64_t columns) {
  return device_tensor(values, torch::kFloat32, torch::kCPU).view({-1, columns});
}

/// Base plus excess of every entry.
float score(const renderer::SparseScores& scores, std::size_t surfel, std::uint16_t index) {
  for (const auto& entry : scores.row(surfel)) {
    if (entry.index == index) return scores.base(surfel) + entry.excess;
  }
  return scores.base(surfel);
}

TEST(ScoresOfLogits, AreOneAffineMapOfAllLogits) {
  const std::vector<float> logits{1.0F, -3.0F, 5.0F, 0.0F, 0.0F, 2.0F};
  const renderer::SparseScores scores = scores_of_logits(table(logits, 3));
  for (std::size_t i = 0; i < logits.size(); ++i) {
    EXPECT_NEAR(score(scores, i / 3, static_cast<std::uint16_t>(i % 3)),
                (logits[i] + 3.0F) / 8.0F, 1e-6)
        << i;
  }
  ASSERT_EQ(scores.row(0).size(), 2U);
  EXPECT_EQ(scores.row(0)[0].index, 2);  // Largest first.
}

TEST(ScoresOfLogits, ALogitAloneWins) {
  const renderer::SparseScores scores = scores_of_logits(table({-2.0F, 7.0F}, 1));
  for (const std::size_t surfel : {0U, 1U}) {
    ASSERT_EQ(scores.row(surfel).size(), 1U);
    EXPECT_GT(scores.row(surfel)[0].excess, 0.0F);
  }
}

TEST(ScoresOfLogits, WithoutColumnsThereIsNothing) {
  const renderer::SparseScores scores = scores_of_logits(torch::zeros({4, 0}));
  EXPECT_EQ(scores.size(), 4U);
  EXPECT_TRUE(scores.row(3).empty());
}

}  // namespace
}  // namespace segsim::reconstruction::internal
