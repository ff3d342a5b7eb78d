/// Several trainings of an arm, and several reconstructions of a scene.

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/experiments/results/table_fixture.h"
#include "tests/experiments/results/trained_run.h"

namespace segsim::experiments {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

/// Counted by hand: 5 of 8, +4 -1, and what the statistics make of these very values.
TEST(Table, TrainingsOfAnArmArePooled) {
  const Trained run(false);
  const results::ResultTable table =
      results::summarise(a_run(12), run.scenes, run.arms, run.trials);
  ASSERT_EQ(table.scenes.size(), 1U);
  const results::GroupSummary& flat = table.scenes[0];
  ASSERT_EQ(flat.arms.size(), 2U);
  const results::ArmSummary &before = *flat.find("before"), &after = *flat.find("after");
  EXPECT_EQ(before.success.trials, 4);
  EXPECT_EQ(after.success.successes, 5);
  EXPECT_EQ(after.success.trials, 8);
  EXPECT_EQ(after.members, 2);
  EXPECT_DOUBLE_EQ(after.spl, 5 * 0.5 / 8);
  EXPECT_EQ(flat.pairs.both, 1);
  EXPECT_EQ(flat.pairs.only_after, 4);
  EXPECT_EQ(flat.pairs.only_before, 1);
  EXPECT_EQ(flat.pairs.neither, 2);
  EXPECT_DOUBLE_EQ(flat.difference.difference, 3.0 / 8.0);
  EXPECT_TRUE(flat.leak);

  // Episodes are sorted by name: chairs (2, 3) before couches (0, 1).
  const double after_values[2][4] = {{0, 1, 1, 1}, {1, 0, 0, 1}};
  const double before_values[4] = {0, 0, 1, 0};
  std::vector<results::SeededValue> rates, differences;
  for (int episode = 0; episode < 4; ++episode) {
    for (int training = 0; training < 2; ++training) {
      rates.push_back({1, training, 0, episode, after_values[training][episode]});
      differences.push_back(rates.back());
      differences.back().value -= before_values[episode];
    }
  }
  const results::Interval rate = results::hierarchical_rate_interval(rates).interval;
  EXPECT_EQ(after.interval().low, rate.low);
  EXPECT_EQ(after.interval().high, rate.high);
  EXPECT_EQ(before.interval().low, results::wilson_interval({1, 4}).low);
  const results::Interval difference = results::hierarchical_interval(differences).interval;
  EXPECT_EQ(flat.difference.interval.low, std::max(-1.0, difference.low));
  EXPECT_EQ(flat.difference.interval.high, std::min(1.0, difference.high));
  EXPECT_EQ(flat.p, results::training_test(differences).p);
  EXPECT_EQ(flat.verdict, results::verdict(flat.pairs, flat.p, flat.difference));

  ASSERT_EQ(table.trainings.size(), 2U);
  EXPECT_EQ(table.trainings[0].success.successes, 3);
  EXPECT_EQ(table.trainings[1].arm, "after.s3");
  EXPECT_EQ(table.trainings[1].pairs.only_after, 2);
  EXPECT_EQ(table.trainings[1].pairs.only_before, 1);

  // Goal classes pool in the same way: chairs are episodes 2 and 3.
  EXPECT_EQ(table.classes[0].name, "chair");
  EXPECT_EQ(table.classes[0].find("after")->success.successes, 2);
  EXPECT_EQ(table.classes[0].find("after")->success.trials, 4);
  EXPECT_EQ(table.classes[0].pairs.only_after, 2);
}

TEST(Table, TrainingsAreToldOneByOne) {
  const Trained run(false);
  const results::ResultTable table =
      results::summarise(a_run(12), run.scenes, run.arms, run.trials);
  const std::string text = results::format_table(table, support::TableFormat::kText);
  for (const char* part : {"Object search before and after fine-tuning (2 trainings)\n",
                           "5/8  62 % [", "+4 -1 of 8",
                           R"(
Training  Seed  Reconstruction  Weights       Score threshold  AP50 held out  SR                  Difference [points]  Pairs
--------  ----  --------------  ------------  ---------------  -------------  ------------------  -------------------  ----------
after     2     1               aaaaaaaaaaaa  0.250            50.0           3/4  75 % [30, 95]  +50 [-14, +79]       +2 -0 of 4
after.s3  3     1               aaaaaaaaaaaa  0.250            50.0           2/4  50 % [15, 85]  +25 [-46, +75]       +2 -1 of 4

SR by training: 75 %, 50 %; mean 62 %, standard deviation 17.7 points (0.0)"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
  EXPECT_THAT(text, Not(HasSubstr("ONE TRAINING")));
  EXPECT_THAT(table.notes, Contains(HasSubstr("LEAKAGE start region: 6 of the 200 views")));
  EXPECT_THAT(table.notes, Not(Contains(HasSubstr("discordant pair"))));

  const nlohmann::json json =
      nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson));
  EXPECT_FALSE(json.at("one_training").get<bool>());
  EXPECT_EQ(json.at("trainings").size(), 2U);
  EXPECT_EQ(json.at("trainings")[1].at("seed"), 3);
  EXPECT_NEAR(json.at("training_rate_sd").get<double>(), 0.125 * std::sqrt(2.0), 1e-12);
  const nlohmann::json& scene = json.at("scenes")[0];
  EXPECT_EQ(scene.at("arms").at("after").at("trainings"), 2);
  EXPECT_TRUE(scene.at("arms").at("after").contains("hierarchical95"));
  EXPECT_FALSE(scene.at("arms").at("after").contains("wilson95"));
  EXPECT_TRUE(scene.at("arms").at("before").contains("wilson95"));
  EXPECT_EQ(scene.at("comparison").at("p_trainings"), scene.at("comparison").at("p"));
  EXPECT_FALSE(scene.at("comparison").contains("p_mcnemar_exact"));

  const std::string csv = results::format_table(table, support::TableFormat::kCsv);
  EXPECT_THAT(csv, HasSubstr("\ntraining,\"after.s3\",0,\"after.s3\",2,4,0.5,"));
  for (std::size_t at = csv.find('\n'); at + 1 < csv.size();) {  // Equal numbers of fields.
    const std::size_t end = csv.find('\n', at + 1);
    const auto commas = [&](std::size_t from, std::size_t to) {
      return std::count(csv.begin() + static_cast<std::ptrdiff_t>(from),
                        csv.begin() + static_cast<std::ptrdiff_t>(to), ',');
    };
    EXPECT_EQ(commas(at, end), commas(0, csv.find('\n'))) << csv.substr(at, end - at);
    at = end;
  }
}

/// A training is compared with 'before' of its own reconstruction.
TEST(Table, ReconstructionsPoolAndPairWithinThemselves) {
  const Trained run(true);
  const results::ResultTable table =
      results::summarise(a_run(20), run.scenes, run.arms, run.trials);
  ASSERT_EQ(table.scenes.size(), 1U);
  EXPECT_FALSE(table.all.has_value());
  const results::GroupSummary& flat = table.scenes[0];
  EXPECT_EQ(flat.title, "Flat");
  EXPECT_EQ(flat.find("before")->success.successes, 3);
  EXPECT_EQ(flat.find("before")->success.trials, 8);
  EXPECT_EQ(flat.find("before")->members, 2);
  EXPECT_EQ(flat.find("after")->success.successes, 8);
  EXPECT_EQ(flat.find("after")->success.trials, 12);
  EXPECT_EQ(flat.pairs.only_after, 5);
  EXPECT_EQ(flat.pairs.only_before, 1);
  EXPECT_EQ(flat.pairs.total(), 12);
  EXPECT_EQ(flat.dropped_pairs, 0);
  ASSERT_EQ(table.trainings.size(), 3U);
  EXPECT_EQ(table.trainings[2].before, "before.r2");
  EXPECT_EQ(table.trainings[2].pairs.only_after, 1);
  EXPECT_EQ(table.trainings[2].pairs.both, 2);
  EXPECT_THAT(results::format_table(table, support::TableFormat::kText),
              HasSubstr("(3 trainings in 2 reconstructions)"));
}

TEST(Table, OneTrainingCanBeChosen) {
  const Trained run(false);
  const results::ResultTable table =
      results::summarise(a_run(12), run.scenes, run.arms, run.trials, "before", "after.s3");
  EXPECT_EQ(table.trainings.size(), 1U);
  EXPECT_EQ(table.scenes[0].pairs.total(), 4);
  EXPECT_EQ(table.scenes[0].pairs.only_before, 1);
  EXPECT_EQ(table.scenes[0].p, results::mcnemar_exact_p(2, 1));
  EXPECT_THAT(table.notes, Contains(HasSubstr("ONE TRAINING")));
  // Trainings of two arms pair by their seeds.
  Trained other(false);
  for (const char* name : {"tuned", "tuned.s3"}) {
    other.arms.push_back(a_row(name, "tuned", 1, std::string(name) == "tuned" ? 2 : 3));
    other.add("flat", name, std::string(name) == "tuned" ? "ssss" : "....");
  }
  const results::ResultTable pairs =
      results::summarise(a_run(20), other.scenes, other.arms, other.trials, "after", "tuned");
  ASSERT_EQ(pairs.trainings.size(), 2U);
  EXPECT_EQ(pairs.trainings[0].before, "after");
  EXPECT_EQ(pairs.trainings[0].pairs.only_after, 1);
  EXPECT_EQ(pairs.trainings[1].before, "after.s3");
  EXPECT_EQ(pairs.trainings[1].pairs.only_before, 2);
}

TEST(Table, OneTrainingIsMarked) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_attributed_episodes());
  for (const support::TableFormat format :
       {support::TableFormat::kText, support::TableFormat::kMarkdown,
        support::TableFormat::kLatex}) {
    EXPECT_THAT(results::format_table(table, format), HasSubstr("fine-tuning (one training)"));
  }
  EXPECT_THAT(results::format_table(table, support::TableFormat::kText),
              HasSubstr("\nOne training: "));
  EXPECT_THAT(results::format_table(table, support::TableFormat::kMarkdown),
              HasSubstr("Success rule: segsim-object. By the strictest named rule, "
                        "habitat-hm3d ("));
  EXPECT_THAT(results::format_table(table, support::TableFormat::kMarkdown),
              HasSubstr("before 0/10 (0 %)"));
  EXPECT_THAT(table.notes, Contains(HasSubstr("ONE TRAINING: \"after\"")));
  EXPECT_TRUE(nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson))
                  .at("one_training")
                  .get<bool>());
  // Two policies with the same weights: no training is what differs.
  std::vector<records::ArmRow> arms = kArms;
  arms[1].weights_sha256 = arms[0].weights_sha256;
  const results::ResultTable same =
      results::summarise(a_run(30), kScenes, arms, ten_attributed_episodes());
  EXPECT_THAT(results::format_table(same, support::TableFormat::kText),
              Not(HasSubstr("ne training")));
  EXPECT_THAT(same.notes, Not(Contains(HasSubstr("ONE TRAINING"))));
}

}  // namespace
}  // namespace segsim::experiments
