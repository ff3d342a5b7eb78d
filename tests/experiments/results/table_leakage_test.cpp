/// What a table says of detectors that had seen what they are tested on.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/formatted.h"
#include "tests/experiments/results/table_fixture.h"
#include "tests/experiments/results/trained_run.h"

namespace segsim::experiments {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

TEST(Table, TrainingViewsInTheStartRegionAreALeak) {
  const results::ResultTable clean =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes());
  EXPECT_THAT(clean.notes, Contains(HasSubstr("Start region: 0 of the 400 views")));
  EXPECT_THAT(clean.notes,
              Contains(HasSubstr("SR 20 % -> 100 % (laboratory) and 25 % -> 50 % (house)")));
  std::vector<records::ArmRow> arms = kArms;
  arms[1].start_leak->near_starts = 17;
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, arms, ten_episodes());
  EXPECT_THAT(table.notes, Contains(HasSubstr("LEAKAGE start region: 17 of the 400 views")));
  arms[1].start_leak.reset();
  arms[1].tuned_on.clear();  // Neither the paper's effect: nothing was adapted.
  const results::ResultTable plain =
      results::summarise(a_run(30), kScenes, arms, ten_episodes());
  EXPECT_THAT(plain.notes, Not(Contains(HasSubstr("tart region"))));
  EXPECT_THAT(plain.notes, Not(Contains(HasSubstr("The paper reports"))));
}

TEST(Table, TrainingViewsWhereTrialsSucceedAreALeak) {
  std::vector<records::TrialRow> trials = ten_episodes();
  const auto table = [&] { return results::summarise(a_run(30), kScenes, kArms, trials); };
  const auto notes = [&] { return table().notes; };
  EXPECT_THAT(notes(), Not(Contains(HasSubstr("top region"))));  // Nothing is known.
  int successes = 0;
  for (records::TrialRow& t : trials) {
    if (t.arm == "after" && t.success) t.why.stop_views = successes++ == 0 ? 40 : 0;
  }
  ASSERT_GT(successes, 1);
  // 40 views at one of the places, none at the others.
  EXPECT_THAT(notes(),
              Contains(AllOf(HasSubstr("LEAKAGE stop region: 1 of the " +
                                       std::to_string(successes) + " successful trials"),
                             HasSubstr(core::print("(%.1f of its views", 40.0 / successes)))));
  EXPECT_THAT(results::format_table(table(), support::TableFormat::kJson),
              HasSubstr("\"near_views\": 1"));
  for (records::TrialRow& t : trials) t.why.stop_views = t.arm == "after" ? 0 : -1;
  EXPECT_THAT(notes(), Contains(StartsWith("Stop region: 0 of the ")));
}

/// The run's two arms with what they had seen of the scene.
results::ResultTable with_exposures(const records::SceneExposure& before,
                                    const records::SceneExposure& after) {
  std::vector<records::ArmRow> arms = kArms;
  arms[0].exposure = before;
  arms[1].exposure = after;
  arms[1].tuned_on.clear();
  return results::summarise(a_run(30), kScenes, arms, ten_episodes());
}

/// What the arm's line of the scene says in the last column.
std::string csv_leakage(const results::ResultTable& table, const std::string& arm) {
  const std::string csv = results::format_table(table, support::TableFormat::kCsv);
  const std::size_t line = csv.find("scene,\"flat\",");
  const std::size_t begin = csv.find("\"" + arm + "\"", line);
  const std::string row = csv.substr(begin, csv.find('\n', begin) - begin);
  return row.substr(row.rfind(',') + 1);
}

TEST(Table, WhatAFileDoesNotSayIsUnknownInEveryForm) {
  const records::SceneExposure unknown{.known = records::TrainingDataKnown::kNothing};
  const results::ResultTable table = with_exposures({}, unknown);
  for (const support::TableFormat format :
       {support::TableFormat::kText, support::TableFormat::kMarkdown,
        support::TableFormat::kLatex, support::TableFormat::kJson}) {
    std::string text = results::format_table(table, format);
    for (std::size_t at = text.find("\n  "); at != std::string::npos; at = text.find("\n  "))
      text.replace(at, 3, " ");  // Lines that were wrapped.
    EXPECT_THAT(text, HasSubstr("LEAKAGE unknown: "));
    EXPECT_THAT(text, HasSubstr("the file does not say what it was trained on."));
  }
  EXPECT_EQ(csv_leakage(table, "after"), "unknown");
  EXPECT_EQ(csv_leakage(table, "before"), "none");
  EXPECT_EQ(csv_leakage(table, "oracle"), "none");
  const auto json =
      nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson));
  EXPECT_EQ(json.at("scenes")[0].at("leakage"), "unknown");
  EXPECT_EQ(json.at("scenes")[0].at("arms").at("before").at("leakage"), "none");
  EXPECT_EQ(json.at("classes")[0].at("leakage"), "unknown");
  EXPECT_EQ(json.at("provenance").at("arms").at("after").at("leakage"), "unknown");
  EXPECT_FALSE(table.scenes[0].leak);

  records::SceneExposure part = unknown;
  part.known = records::TrainingDataKnown::kPart;
  EXPECT_THAT(
      with_exposures({}, part).notes,
      Contains("LEAKAGE unknown: \"after\" (two.bin): the file does not say all that it "
               "was trained on."));
  // Results of a version that did not look.
  EXPECT_THAT(
      results::summarise(a_run(30), kScenes, kArms, ten_episodes()).notes,
      Contains("LEAKAGE unknown: \"before\" (one.bin): these results do not say what it "
               "was trained on."));
}

TEST(Table, ArmsThatSawNoSceneSaySo) {
  const results::ResultTable table = with_exposures({}, {});
  EXPECT_THAT(table.notes,
              Contains("Leakage none: no view of the evaluation scenes is in what \"before\" "
                       "and \"after\" were trained on."));
  EXPECT_THAT(table.notes, Not(Contains(HasSubstr("LEAKAGE"))));
  EXPECT_EQ(csv_leakage(table, "after"), "none");
  const auto json =
      nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson));
  EXPECT_EQ(json.at("scenes")[0].at("leakage"), "none");
}

TEST(Table, AnArmThatSawTheSceneLeaksWhicheverArmItIs) {
  const records::SceneExposure seen{.trained_on = {"flat"}};
  const results::ResultTable after = with_exposures({}, seen);
  EXPECT_TRUE(after.scenes[0].leak);
  EXPECT_THAT(after.notes, Contains(HasSubstr("LEAKAGE scene (*): \"after\" was fine-tuned")));
  const results::ResultTable before = with_exposures(seen, {});
  EXPECT_FALSE(before.scenes[0].leak);
  EXPECT_THAT(before.notes,
              Contains("LEAKAGE scene: \"before\" was trained on views of Flat."));
  EXPECT_EQ(csv_leakage(before, "before"), "scene");
  EXPECT_EQ(csv_leakage(before, "after"), "none");

  // Without a comparison, too.
  std::vector<records::ArmRow> alone{kArms[0]};
  alone[0].exposure = seen;
  const results::ResultTable single =
      results::summarise(a_run(10), kScenes, alone, ten_episodes());
  EXPECT_THAT(single.notes, Contains(HasSubstr("LEAKAGE scene: \"before\" was trained")));

  const records::SceneExposure alike{.same_name = {"flat"}};
  const results::ResultTable hint = with_exposures({}, alike);
  EXPECT_THAT(hint.notes, Contains(HasSubstr("a scene of the same name as flat but another")));
  EXPECT_EQ(csv_leakage(hint, "after"), "unknown");
}

TEST(Table, ThresholdsChosenOnTheScenesAreToldInOneLine) {
  const records::SceneExposure chosen{.threshold_on = {"flat"}};
  EXPECT_THAT(
      with_exposures(chosen, chosen).notes,
      Contains("Score thresholds of \"before\" and \"after\" were chosen on other views "
               "of the same scenes."));
  EXPECT_THAT(with_exposures({}, {}).notes, Not(Contains(HasSubstr("hreshold"))));
  std::vector<records::ArmRow> arms = kArms;
  arms[0].exposure = arms[1].exposure = chosen;
  arms[1].score_threshold = 0.4;  // The spec's own.
  EXPECT_THAT(
      results::summarise(a_run(30), kScenes, arms, ten_episodes()).notes,
      Contains("The score threshold of \"before\" was chosen on other views of the same "
               "scenes."));
}

/// What all trainings of an arm share is told once, of the arm.
TEST(Table, LeakageIsThatOfAllTrainings) {
  Trained run(true);
  for (records::ArmRow& arm : run.arms) {
    arm.tuned_on.clear();
    arm.exposure = records::SceneExposure{};
    arm.exposure->threshold_on = {arm.reconstruction == 1 ? "flat" : "flat.r2"};
    arm.score_threshold = -1;
  }
  const auto table = [&] {
    return results::summarise(a_run(20), run.scenes, run.arms, run.trials);
  };
  const auto json = [&] {
    return nlohmann::json::parse(results::format_table(table(), support::TableFormat::kJson));
  };
  EXPECT_FALSE(table().scenes[0].leak);
  EXPECT_THAT(table().notes,
              Contains("Leakage none: no view of the evaluation scenes is in what \"before\" "
                       "and \"after\" were trained on."));
  EXPECT_THAT(table().notes,
              Contains("Score thresholds of \"before\" and \"after\" were chosen on other "
                       "views of the same scenes."));
  EXPECT_EQ(csv_leakage(table(), "after"), "none");

  for (records::ArmRow& arm : run.arms) {
    if (arm.family != "after") continue;
    arm.exposure->known = records::TrainingDataKnown::kPart;
    arm.exposure->trained_on = arm.exposure->threshold_on;
  }
  EXPECT_TRUE(table().scenes[0].leak);
  EXPECT_THAT(table().notes,
              Contains(StartsWith("LEAKAGE scene (*): \"after\" was fine-tuned")));
  EXPECT_THAT(table().notes,
              Contains("LEAKAGE unknown: \"after\" (3 files): the files do not say all that "
                       "it was trained on."));
  EXPECT_THAT(table().notes,
              Not(Contains(AllOf(StartsWith("LEAKAGE"), HasSubstr("after.s3")))));
  // One of the trainings in a comparison of its own: the arm is still told of as a whole.
  const results::ResultTable chosen =
      results::summarise(a_run(20), run.scenes, run.arms, run.trials, "before", "after.s3");
  EXPECT_THAT(chosen.notes, Contains(StartsWith("LEAKAGE scene (*): \"after.s3\"")));
  EXPECT_THAT(chosen.notes,
              Contains("LEAKAGE scene: \"after\" was trained on views of Flat."));

  // One training that differs from the others is told by itself, and makes the arm's word.
  for (records::ArmRow& arm : run.arms) {
    arm.exposure = records::SceneExposure{};
    if (arm.name == "after.r2") arm.exposure->trained_on = {"flat.r2"};
  }
  EXPECT_TRUE(table().scenes[0].leak);
  EXPECT_THAT(
      table().notes,
      Contains("LEAKAGE scene: \"after.r2\" (one training) was trained on views of Flat."));
  EXPECT_THAT(table().notes,
              Contains("Leakage none: no view of the evaluation scenes is in what \"before\", "
                       "\"after\" (one training) and \"after.s3\" (one training) were trained "
                       "on."));
  EXPECT_EQ(csv_leakage(table(), "after"), "scene");
  EXPECT_EQ(csv_leakage(table(), "before"), "none");
  EXPECT_EQ(json().at("scenes")[0].at("leakage"), "scene");
  EXPECT_EQ(json().at("scenes")[0].at("arms").at("after").at("leakage"), "scene");
  EXPECT_EQ(json().at("trainings")[0].at("leakage"), "none");
  EXPECT_EQ(json().at("trainings")[2].at("leakage"), "scene");
  EXPECT_THAT(results::format_table(table(), support::TableFormat::kCsv),
              ContainsRegex("\ntraining,\"after\\.r2\",[^\n]*,scene\n"));
  EXPECT_THAT(results::format_table(table(), support::TableFormat::kCsv),
              ContainsRegex("\ntraining,\"after\\.s3\",[^\n]*,none\n"));
}

}  // namespace
}  // namespace segsim::experiments
