/// What a table counts: pairs, rates, what is left out, and what its notes say of that.

#include "experiments/results/table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "tests/experiments/results/table_fixture.h"

namespace segsim::experiments {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

TEST(Table, CountsPairsByHand) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes());
  ASSERT_EQ(table.scenes.size(), 1U);
  const results::GroupSummary& flat = table.scenes[0];
  EXPECT_EQ(flat.find("before")->success.successes, 4);
  EXPECT_EQ(flat.find("after")->success.successes, 8);
  EXPECT_EQ(flat.pairs.both, 3);
  EXPECT_EQ(flat.pairs.only_after, 5);
  EXPECT_EQ(flat.pairs.only_before, 1);
  EXPECT_EQ(flat.pairs.neither, 1);
  EXPECT_NEAR(flat.p, 14.0 / 64.0, 1e-12);  // 2 (C(6,0) + C(6,1)) / 2^6
  EXPECT_DOUBLE_EQ(flat.find("after")->spl, 0.4);
  EXPECT_TRUE(flat.leak);
  EXPECT_EQ(table.oracle, "oracle");
  EXPECT_FALSE(table.all.has_value());
  ASSERT_EQ(table.classes.size(), 2U);
  EXPECT_EQ(table.classes[0].name, "chair");
  EXPECT_EQ(table.classes[0].pairs.total(), 5);
}

TEST(Table, PairedMeansByHand) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes());
  // SPL is 0.5 for each success, and nothing else.
  const results::GroupSummary& scene = table.scenes[0];
  const double expected =
      0.5 * (scene.pairs.only_after - scene.pairs.only_before) / scene.pairs.total();
  EXPECT_NEAR(scene.spl.difference.mean, expected, 1e-12);
  EXPECT_GT(scene.spl.difference.interval.low, -0.5);
  EXPECT_LT(scene.spl.difference.interval.low, expected);
  EXPECT_EQ(scene.sim_s.difference.mean, 0.0);
  EXPECT_EQ(scene.sim_s.p, 1.0);
  EXPECT_FALSE(table.all.has_value());
}

TEST(Table, ArmsCanBeChosenAndUnknownOnesAreRefused) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes(), "after", "oracle");
  EXPECT_EQ(table.scenes[0].pairs.only_after, 2);
  EXPECT_THROW((void)results::summarise(a_run(30), kScenes, kArms, ten_episodes(), "afer", ""),
               core::InputError);
}

TEST(Table, AnUnfinishedRunIsMarked) {
  const results::ResultTable table =
      results::summarise(a_run(60), kScenes, kArms, ten_episodes());
  EXPECT_THAT(table.notes, Contains(HasSubstr("INTERIM: 30 of 60 trials")));
}

TEST(Table, FailedTrialsAreInNoRateAndNoPair) {
  std::vector<records::TrialRow> trials = ten_episodes();
  trials[0].outcome = records::TrialOutcome::kError;  // "before" of the first episode
  const results::ResultTable table = results::summarise(a_run(30), kScenes, kArms, trials);
  EXPECT_EQ(table.scenes[0].find("before")->success.trials, 9);
  EXPECT_EQ(table.scenes[0].pairs.total(), 9);
  EXPECT_EQ(table.scenes[0].dropped_pairs, 1);
  EXPECT_EQ(table.finished_trials, 29);
  EXPECT_THAT(table.notes, Contains(HasSubstr("1 trial failed")));
  EXPECT_THAT(table.notes, Contains(HasSubstr("1 episode without")));
}

TEST(Table, RepetitionsAreNotIndependentEpisodes) {
  std::vector<records::TrialRow> trials = ten_episodes();
  const std::size_t single = trials.size();
  for (int repetition = 1; repetition < 3; ++repetition) {
    for (std::size_t i = 0; i < single; ++i) {
      trials.push_back(trials[i]);
      trials.back().repetition = repetition;
    }
  }
  // One repetition of three turned round changes no episode.
  for (records::TrialRow& t : trials) {
    if (t.repetition == 2) t.success = !t.success;
  }
  const results::ResultTable table = results::summarise(a_run(90), kScenes, kArms, trials);
  EXPECT_EQ(table.scenes[0].pairs.total(), 10);
  EXPECT_EQ(table.scenes[0].find("after")->success.successes, 8);
  EXPECT_EQ(table.scenes[0].find("after")->trials, 30);
}

TEST(Table, InfeasibleEpisodesAreInNoRateAndListed) {
  std::vector<records::TrialRow> trials = ten_attributed_episodes();
  for (records::TrialRow& t : trials) {
    if (t.episode != "flat/couch/02") continue;
    t.outcome = records::TrialOutcome::kInfeasible;
    t.why.cause = records::Cause::kInfeasible;
    t.success = false;
  }
  const results::ResultTable table = results::summarise(a_run(30), kScenes, kArms, trials);
  EXPECT_EQ(table.scenes[0].find("before")->success.trials, 9);
  EXPECT_EQ(table.scenes[0].find("before")->excluded_trials, 1);
  EXPECT_EQ(table.scenes[0].pairs.total(), 9);
  EXPECT_THAT(table.notes,
              Contains(HasSubstr("1 episode infeasible, in no rate: flat/couch/02")));
  const std::string csv = results::format_table(table, support::TableFormat::kCsv);
  EXPECT_THAT(csv, Not(HasSubstr("nan")));
  EXPECT_THAT(csv, Not(HasSubstr("inf,")));
}

TEST(Table, EpisodeSetsThatAreHardForTheOracleAreFlagged) {
  std::vector<records::SceneRow> scenes = kScenes;
  scenes[0].oracle_successes = 18;
  scenes[0].oracle_episodes = 20;
  EXPECT_THAT(results::summarise(a_run(30), scenes, kArms, ten_episodes()).notes,
              Contains(HasSubstr("FLAGGED episodes: Flat: the oracle-path arm solved 18/20")));
  scenes[0].oracle_successes = 19;
  EXPECT_THAT(results::summarise(a_run(30), scenes, kArms, ten_episodes()).notes,
              Contains(HasSubstr("Flat: the oracle-path arm solved 19/20 of the")));
}

TEST(Table, WhoGaveUpInSightOfTheGoalIsTold) {
  std::vector<records::TrialRow> trials = ten_attributed_episodes();
  const auto notes = [&] {
    return results::summarise(a_run(30), kScenes, kArms, trials).notes;
  };
  EXPECT_THAT(notes(), Not(Contains(HasSubstr("gave up in sight"))));
  const auto given_up = std::find_if(trials.begin(), trials.end(), [](const auto& t) {
    return t.arm == "before" && t.success;
  });
  ASSERT_NE(given_up, trials.end());
  given_up->success = false;
  given_up->outcome = records::TrialOutcome::kGaveUp;
  given_up->stop_reason = core::StopReason::kNoFrontierLeft;
  given_up->why.cause = records::Cause::kFalseNegative;
  EXPECT_THAT(notes(), Contains(AllOf(HasSubstr("Flat: some trials gave up in sight"),
                                      HasSubstr("before 4/10 instead of 3 would succeed"))));
}

TEST(Table, FewDiscordantPairsAndAWeakOracleAreTold) {
  std::vector<records::TrialRow> trials = ten_episodes();
  for (records::TrialRow& t : trials) {
    if (t.arm == "after") t.success = trials[0].success && t.episode == trials[0].episode;
    if (t.arm == "oracle" && t.goal_class == "chair") t.success = false;
  }
  const results::ResultTable table = results::summarise(a_run(30), kScenes, kArms, trials);
  EXPECT_THAT(table.notes, Contains(HasSubstr("at least 6")));
  EXPECT_THAT(table.notes, Contains(HasSubstr("oracle SR 5/10")));
}

}  // namespace
}  // namespace segsim::experiments
