#include "experiments/records/row_names.h"

#include <gtest/gtest.h>

#include "tests/error_message.h"

namespace segsim::experiments {
namespace {

records::TrialRow a_row() {
  records::TrialRow row;
  row.trial_id = 12;
  row.outcome = "gave_up";
  row.stop_reason = "no_frontier_left";
  row.why.cause = "never_saw_target";
  return row;
}

std::string refusal(const records::TrialRow& row) {
  return tests::input_error_of([&] { records::check_names(row, "results.sqlite"); });
}

TEST(RowNames, WhatTheProgramWritesIsKnown) {
  EXPECT_EQ(refusal(a_row()), "no error");
  records::TrialRow row = a_row();
  row.stop_reason = "";  // Time was over.
  EXPECT_EQ(refusal(row), "no error");
  row.why.cause = "";  // Older than attribution.
  EXPECT_EQ(refusal(row), "no error");
  for (const char* no_trial : {"error", "infeasible", "trivial"}) {
    row.outcome = no_trial;
    EXPECT_EQ(refusal(row), "no error");
  }
}

TEST(RowNames, AWordThatIsNotKnownIsNamedWithFileTrialAndColumn) {
  records::TrialRow row = a_row();
  row.stop_reason = "goal_raeched";
  EXPECT_EQ(refusal(row).substr(0, 69),
            "results.sqlite: trial 12: stop_reason: expected a stop reason (goal_r");
  EXPECT_TRUE(refusal(row).ends_with("found \"goal_raeched\""));
  row = a_row();
  row.outcome = "succes";
  EXPECT_TRUE(refusal(row).starts_with("results.sqlite: trial 12: outcome: expected"));
  row = a_row();
  row.why.cause = "bad_luck";
  EXPECT_TRUE(refusal(row).starts_with("results.sqlite: trial 12: cause: expected"));
  EXPECT_TRUE(refusal(row).ends_with("found \"bad_luck\""));
}

TEST(RowNames, FilesLieBelowTheFolderOfTheRun) {
  records::TrialRow row = a_row();
  row.log = "logs/a..b/couch.json.gz";
  row.picture = "./pictures/../tracks/x.png";
  EXPECT_EQ(refusal(row), "no error");
  for (const char* outside : {"/etc/passwd", "../other/log.json.gz", "logs/../../x", ".."}) {
    row = a_row();
    row.log = outside;
    EXPECT_EQ(refusal(row),
              "results.sqlite: trial 12: log: expected a file below the folder "
              "of the run, found \"" +
                  std::string(outside) + "\"");
    row = a_row();
    row.picture = outside;
    EXPECT_TRUE(refusal(row).starts_with("results.sqlite: trial 12: picture: expected"));
  }
}

}  // namespace
}  // namespace segsim::experiments
