#include "experiments/results/navigation_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/check.h"
#include "experiments/results/training_grids.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;
using testing::Not;

/// Eight of ten only after, one both, one neither; the oracle solves all.
results::ResultTable a_result() {
  records::RunRow run;
  run.run_id = 2;
  run.name = "room";
  run.title = "Room";
  run.planned_trials = 30;
  run.success_profile = "segsim-object: STOP";
  std::vector<records::TrialRow> trials;
  for (int k = 0; k < 10; ++k) {
    for (const std::string& arm : std::vector<std::string>{"before", "after", "oracle"}) {
      records::TrialRow t;
      t.arm = arm;
      t.scene = "room";
      t.goal_class = "couch";
      t.episode = "room/couch/" + std::to_string(k);
      t.success = arm == "oracle" || (arm == "after" ? k < 9 : k < 1);
      t.outcome =
          t.success ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
      trials.push_back(t);
    }
  }
  return results::summarise(run, {{"room", "Break room", "s", "e", 10}},
                            {{"before", "a.bin", "c", "", -1, {}},
                             {"after", "b.bin", "d", "room", -1, {}},
                             {"oracle", "oracle", "", "", -1, {}}},
                            trials);
}

std::vector<results::NavigationEntry> entries() {
  return {{"Laboratory Room", "Break room", a_result(), {}},
          {"House", "House", std::nullopt, "make it with segsim run"}};
}

TEST(NavigationTable, StandsBesideThePapersRowsAndTheirMissingNumber) {
  const std::string text =
      results::format_navigation_table(entries(), support::TableFormat::kMarkdown);
  EXPECT_THAT(text,
              HasSubstr("| Laboratory Room | 20 % | 100 % | not given | Break room | 10 | "
                        "1/10  10 % [2, 40] | 9/10  90 % [60, 98] | +80 [+37, +92] | "
                        "+8 -0 of 10 | 0.008 | improved | 10/10  100 % [72, 100] | scene |"));
  EXPECT_THAT(text, HasSubstr("| House | 25 % | 50 % | not given | House | not run | - |"));
  EXPECT_THAT(text, HasSubstr("Not run: House: make it with segsim run"));
  EXPECT_THAT(text, HasSubstr("room: LEAKAGE scene"));
}

TEST(NavigationTable, TheStrictestRuleStandsBesideTheRunsOwn) {
  std::vector<results::NavigationEntry> runs = entries();
  for (results::ArmSummary& arm : runs[0].result->scenes[0].arms) {
    arm.insights.trials = 10;
    arm.insights.profiles = {{results::internal::kStrictestRule, arm.arm == "before" ? 1 : 4}};
  }
  const std::string text =
      results::format_navigation_table(runs, support::TableFormat::kMarkdown);
  EXPECT_THAT(text, HasSubstr("| Break room | segsim-object | 1/10  10 % [2, 40] | 9/10"));
  EXPECT_THAT(
      text,
      HasSubstr("| Break room | habitat-hm3d | 1/10  10 % | 4/10  40 % | 4/10  40 % | - |"));
}

TEST(NavigationTable, WhatIsNotKnownIsUnknown) {
  std::vector<results::NavigationEntry> runs = entries();
  records::ArmRow& after = runs[0].result->arm_rows[1];
  after.tuned_on.clear();
  after.exposure = records::SceneExposure{.known = records::TrainingDataKnown::kNothing};
  EXPECT_THAT(results::format_navigation_table(runs, support::TableFormat::kMarkdown),
              HasSubstr("10/10  100 % [72, 100] | unknown |"));
  const auto json = nlohmann::json::parse(
      results::format_navigation_table(runs, support::TableFormat::kJson));
  EXPECT_EQ(json["rows"][0]["leakage"], "unknown");
}

TEST(NavigationTable, EveryFormSaysTheSame) {
  const auto json = nlohmann::json::parse(
      results::format_navigation_table(entries(), support::TableFormat::kJson));
  EXPECT_EQ(json["rows"].size(), 2U);
  EXPECT_EQ(json["rows"][0]["before"]["successes"], 1);
  EXPECT_EQ(json["rows"][0]["after"]["successes"], 9);
  EXPECT_NEAR(json["rows"][0]["p_mcnemar_exact"].get<double>(), 0.0078125, 1e-12);
  EXPECT_EQ(json["rows"][0]["leakage"], "scene");
  EXPECT_TRUE(json["rows"][0]["paper"]["episodes"].is_null());
  EXPECT_EQ(json["rows"][1]["missing"], "make it with segsim run");
  const std::string latex =
      results::format_navigation_table(entries(), support::TableFormat::kLatex);
  EXPECT_THAT(latex,
              HasSubstr(R"(Laboratory Room & 20 \% & 100 \% & not given & Break room)"));
  EXPECT_THAT(latex, HasSubstr(R"(\begin{tabular}{lccccccccccccc})"));
  const std::string csv =
      results::format_navigation_table(entries(), support::TableFormat::kCsv);
  EXPECT_THAT(csv, HasSubstr("Laboratory Room,20 %,100 %,not given,Break room,10,"));
  EXPECT_THAT(csv, HasSubstr("\"1/10  10 % [2, 40]\""));
}

TEST(NavigationTable, ScenesThatThePaperHasNotHaveNoPaperFigures) {
  const std::vector<results::NavigationEntry> own{{"", "Flat", a_result(), {}}};
  const std::string text =
      results::format_navigation_table(own, support::TableFormat::kMarkdown);
  EXPECT_THAT(text, HasSubstr("| - | - | - | - | Break room | 10 |"));
  EXPECT_THAT(text, Not(HasSubstr("not given")));
  const std::vector<results::NavigationEntry> wrong{{"Kitchen", "x", std::nullopt, "y"}};
  EXPECT_THROW((void)results::format_navigation_table(wrong, support::TableFormat::kText),
               core::ContractViolation);
}

}  // namespace
}  // namespace segsim::experiments
