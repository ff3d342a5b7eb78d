#include "reconstruction/labels/assignment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/check.h"
#include "core/random.h"

namespace segsim::reconstruction {
namespace {

/// Sum of an assignment; fails if a column is taken twice or too few pairs were made.
double sum_of(const std::vector<double>& cost, std::size_t rows, std::size_t columns,
              const std::vector<int>& column_of) {
  std::vector<int> taken(columns, 0);
  double sum = 0.0;
  std::size_t pairs = 0;
  EXPECT_EQ(column_of.size(), rows);
  for (std::size_t r = 0; r < column_of.size(); ++r) {
    if (column_of[r] == kUnassigned) continue;
    const auto c = static_cast<std::size_t>(column_of[r]);
    EXPECT_LT(c, columns);
    EXPECT_EQ(taken[c]++, 0);
    sum += cost[r * columns + c];
    ++pairs;
  }
  EXPECT_EQ(pairs, std::min(rows, columns));
  return sum;
}

/// Smallest sum over all ways, by permutations of the larger side.
double brute_force(const std::vector<double>& cost, std::size_t rows, std::size_t columns) {
  const bool wide = columns >= rows;
  std::vector<std::size_t> order(std::max(rows, columns));
  std::iota(order.begin(), order.end(), 0U);
  double best = std::numeric_limits<double>::infinity();
  do {
    double sum = 0.0;
    for (std::size_t i = 0; i < std::min(rows, columns); ++i) {
      sum += wide ? cost[i * columns + order[i]] : cost[order[i] * columns + i];
    }
    best = std::min(best, sum);
  } while (std::next_permutation(order.begin(), order.end()));
  return best;
}

TEST(Assignment, IsTheBestOfAllPermutations) {
  core::RandomStream random(5, "assignment");
  for (int trial = 0; trial < 400; ++trial) {
    const std::size_t rows = 1 + random.index(7), columns = 1 + random.index(7);
    std::vector<double> cost(rows * columns);
    // Every third trial has many ties, every fourth negative costs.
    for (double& c : cost) {
      c = trial % 3 == 0 ? random.index(3) : random.uniform(trial % 4 == 0 ? -2.0 : 0.0, 3.0);
    }
    const std::vector<int> found = assign(cost, rows, columns);
    EXPECT_NEAR(sum_of(cost, rows, columns, found), brute_force(cost, rows, columns), 1e-12)
        << rows << " x " << columns << ", trial " << trial;
  }
}

TEST(Assignment, FindsAPermutationPlantedInALargeMatrix) {
  core::RandomStream random(6, "assignment");
  constexpr std::size_t kRows = 30, kColumns = 150;
  std::vector<std::size_t> planted(kColumns);
  std::iota(planted.begin(), planted.end(), 0U);
  for (std::size_t i = 0; i < kRows; ++i) {
    std::swap(planted[i], planted[i + random.index(static_cast<std::uint32_t>(kColumns - i))]);
  }
  std::vector<double> cost(kRows * kColumns);
  for (double& c : cost) c = random.uniform(1.0, 2.0);
  for (std::size_t r = 0; r < kRows; ++r) cost[r * kColumns + planted[r]] = 0.5;
  const std::vector<int> found = assign(cost, kRows, kColumns);
  for (std::size_t r = 0; r < kRows; ++r) {
    EXPECT_EQ(found[r], static_cast<int>(planted[r]));
  }
}

TEST(Assignment, ACheapColumnGoesToWhoLosesMostWithoutIt) {
  // Taking the smallest entry first (row 0, column 0) would cost 1 + 10.
  EXPECT_EQ(assign(std::vector<double>{1.0, 2.0, 1.5, 10.0}, 2, 2), (std::vector<int>{1, 0}));
}

TEST(Assignment, WithoutRowsOrColumnsNobodyIsAssigned) {
  EXPECT_TRUE(assign({}, 0, 4).empty());
  EXPECT_EQ(assign({}, 2, 0), (std::vector<int>{kUnassigned, kUnassigned}));
}

TEST(Assignment, BadCostsAreRefused) {
  const std::vector<double> nan{1.0, std::nan("")}, infinite{INFINITY, 1.0};
  EXPECT_THROW(static_cast<void>(assign(nan, 1, 2)), core::ContractViolation);
  EXPECT_THROW(static_cast<void>(assign(infinite, 2, 1)), core::ContractViolation);
  EXPECT_THROW(static_cast<void>(assign(nan, 2, 2)), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::reconstruction
