#include "core/random.h"

#include <cmath>
#include <set>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace segsim::core {
namespace {

using ::testing::ElementsAre;

TEST(Philox, MatchesTheKnownAnswersOfItsAuthors) {
  // Random123's kat_vectors for philox4x32-10.
  EXPECT_THAT(philox4x32({0, 0, 0, 0}, {0, 0}),
              ElementsAre(0x6627e8d5U, 0xe169c58dU, 0xbc57ac4cU, 0x9b00dbd8U));
  EXPECT_THAT(philox4x32({0xffffffffU, 0xffffffffU, 0xffffffffU, 0xffffffffU},
                         {0xffffffffU, 0xffffffffU}),
              ElementsAre(0x408f276dU, 0x41c83b0eU, 0xa20bc7c6U, 0x6d5451fdU));
}

TEST(RandomStream, EqualNamesGiveEqualNumbersAndOthersDoNot) {
  RandomStream a(1, "noise", 5), b(1, "noise", 5), c(1, "noise", 6), d(1, "noisf", 5),
      e(2, "noise", 5);
  std::set<std::uint32_t> firsts;
  const std::uint32_t first = a.next_u32();
  EXPECT_EQ(first, b.next_u32());
  for (RandomStream* stream : {&c, &d, &e}) firsts.insert(stream->next_u32());
  firsts.insert(first);
  EXPECT_EQ(firsts.size(), 4U);
}

TEST(RandomStream, UniformAndNormalHaveTheirMoments) {
  RandomStream stream(7, "moments");
  constexpr int kCount = 100000;
  double sum = 0, sum_normal = 0, sum_square = 0;
  for (int i = 0; i < kCount; ++i) {
    const double u = stream.uniform();
    ASSERT_GE(u, 0.0);
    ASSERT_LT(u, 1.0);
    sum += u;
    const double z = stream.normal();
    sum_normal += z;
    sum_square += z * z;
  }
  EXPECT_NEAR(sum / kCount, 0.5, 0.005);
  EXPECT_NEAR(sum_normal / kCount, 0.0, 0.015);
  EXPECT_NEAR(sum_square / kCount, 1.0, 0.02);
}

TEST(RandomStream, IndexCoversItsRangeEvenly) {
  RandomStream stream(3, "index");
  std::vector<int> counts(6);
  for (int i = 0; i < 60000; ++i) ++counts.at(stream.index(6));
  for (const int count : counts) EXPECT_NEAR(count, 10000, 500);
}

}  // namespace
}  // namespace segsim::core
