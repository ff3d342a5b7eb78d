/// An arm compared with itself is not found to be better.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.h"
#include "tests/experiments/results/table_fixture.h"

namespace segsim::experiments {
namespace {

TEST(Table, TheSameArmTwiceHasNoDiscordantPairs) {
  std::vector<records::TrialRow> trials;
  for (const records::TrialRow& t : ten_episodes()) {
    if (t.arm != "before") continue;
    trials.push_back(t);
    trials.push_back(t);
    trials.back().arm = "after";
  }
  const results::GroupSummary group =
      results::summarise(a_run(20), kScenes, kArms, trials).scenes[0];
  EXPECT_EQ(group.pairs.discordant(), 0);
  EXPECT_EQ(group.p, 1.0);
}

/// Trials of two arms that are equally good: each succeeds in an episode with its probability.
std::vector<records::TrialRow> equal_arms(std::uint64_t seed, bool common_numbers) {
  core::RandomStream random(seed, "a/a");
  std::vector<records::TrialRow> trials;
  for (int k = 0; k < 40; ++k) {
    const double ease = random.uniform();
    const double shared = random.uniform();
    for (const std::string& arm : std::vector<std::string>{"before", "after"}) {
      records::TrialRow t;
      t.arm = arm;
      t.scene = "flat";
      t.goal_class = "chair";
      t.episode = "flat/chair/" + std::to_string(k);
      t.success = (common_numbers ? shared : random.uniform()) < ease;
      t.outcome =
          t.success ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
      trials.push_back(t);
    }
  }
  return trials;
}

TEST(Table, TheSameArmTwiceIsRarelySignificant) {
  const std::vector<records::ArmRow> arms(kArms.begin(), kArms.begin() + 2);
  int significant = 0, discordant = 0;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    const results::ResultTable table =
        results::summarise(a_run(80), kScenes, arms, equal_arms(seed, false));
    significant += table.scenes[0].p < 0.05 ? 1 : 0;
    discordant += table.scenes[0].pairs.discordant();
  }
  EXPECT_LE(significant, 16);       // 8 % of 200; the exact test keeps below 5 % on average.
  EXPECT_GE(discordant, 200 * 10);  // The arms did differ: a third of all pairs does.
}

TEST(Table, TheSameArmTwiceWithTheSameNoiseHasNoDiscordantPair) {
  const std::vector<records::ArmRow> arms(kArms.begin(), kArms.begin() + 2);
  const results::ResultTable table =
      results::summarise(a_run(80), kScenes, arms, equal_arms(7, true));
  EXPECT_EQ(table.scenes[0].pairs.discordant(), 0);
  EXPECT_EQ(table.scenes[0].p, 1.0);
}

}  // namespace
}  // namespace segsim::experiments
