#include "experiments/records/row_words.h"

#include <string>

#include <gtest/gtest.h>

#include "tests/error_message.h"
#include "tests/experiments/records/store_fixture.h"

namespace segsim::experiments {
namespace {

TEST(RowWords, OutcomesOfTheSimulatorKeepTheirNames) {
  for (const auto outcome :
       {sim::Outcome::kSuccess, sim::Outcome::kStoppedFar, sim::Outcome::kNotVisible,
        sim::Outcome::kTimeout, sim::Outcome::kGaveUp, sim::Outcome::kCollision,
        sim::Outcome::kAborted}) {
    const records::TrialOutcome stored = records::trial_outcome(outcome);
    EXPECT_STREQ(records::to_string(stored), sim::to_string(outcome));
    EXPECT_EQ(records::simulated(stored), outcome);
  }
  for (const auto outcome : {records::TrialOutcome::kInfeasible,
                             records::TrialOutcome::kTrivial, records::TrialOutcome::kError}) {
    EXPECT_EQ(records::simulated(outcome), std::nullopt) << records::to_string(outcome);
  }
}

TEST(RowWords, NoneIsAnEmptyWord) {
  std::optional<core::StopReason> reason = core::StopReason::kStuck;
  EXPECT_STREQ(records::word_of(reason), "stuck");
  records::read_word("", "here", reason);
  EXPECT_EQ(reason, std::nullopt);
  EXPECT_STREQ(records::word_of(reason), "");
  std::optional<records::Cause> cause = records::Cause::kStuck;
  records::read_word("", "here", cause);
  EXPECT_EQ(cause, std::nullopt);
  records::read_word("never_saw_target", "here", cause);
  EXPECT_EQ(cause, records::Cause::kNeverSawTarget);
}

/// A store whose only trial was altered by hand.
class AlteredStoreTest : public StoreTest {
 protected:
  AlteredStoreTest() {
    records::Store store(file_);
    run_id_ = begin(store);
    records::TrialRow trial = a_trial("before", "b/chair/00", false);
    trial.outcome = records::TrialOutcome::kGaveUp;
    trial.stop_reason = core::StopReason::kNoFrontierLeft;
    trial.why.cause = records::Cause::kNeverSawTarget;
    store.add_trial(run_id_, trial);
  }

  /// Why the trials cannot be read, after the name of the file, if they cannot.
  [[nodiscard]] std::string refusal(const std::string& change) const {
    execute_sql(file_, change.c_str());
    const records::Store store = records::Store::for_reading(file_);
    const std::string error = tests::input_error_of([&] { (void)store.trials(run_id_); });
    const std::string name = file_.string() + ": ";
    return error.starts_with(name) ? error.substr(name.size()) : error;
  }

  std::int64_t run_id_ = 0;
};

TEST_F(AlteredStoreTest, AWordThatIsNotKnownIsNamedWithFileTrialAndColumn) {
  EXPECT_EQ(refusal("UPDATE trial SET outcome = 'trivial'"), "no error");
  std::string why = refusal("UPDATE trial SET outcome = 'succes'");
  EXPECT_TRUE(why.starts_with("trial 1: outcome: expected an outcome (success, ")) << why;
  EXPECT_TRUE(why.ends_with("found \"succes\"")) << why;
  why = refusal("UPDATE trial SET outcome = 'gave_up', stop_reason = 'goal_raeched'");
  EXPECT_TRUE(why.starts_with("trial 1: stop_reason: expected a stop reason (goal_r")) << why;
  EXPECT_TRUE(why.ends_with("found \"goal_raeched\"")) << why;
  EXPECT_EQ(refusal("UPDATE trial SET stop_reason = ''"), "no error");
  why = refusal("UPDATE attribution SET cause = 'bad_luck'");
  EXPECT_TRUE(why.starts_with("trial 1: cause: expected a failure cause (")) << why;
  EXPECT_TRUE(why.ends_with("found \"bad_luck\"")) << why;
}

TEST_F(AlteredStoreTest, FilesLieBelowTheFolderOfTheRun) {
  EXPECT_EQ(refusal("UPDATE attribution SET log = 'logs/a..b/couch.json.gz'"), "no error");
  EXPECT_EQ(refusal("UPDATE trial SET picture = './pictures/../tracks/x.png'"), "no error");
  for (const std::string outside : {"/etc/passwd", "../other/x", "logs/../../x", ".."}) {
    EXPECT_EQ(refusal("UPDATE attribution SET log = '" + outside + "'"),
              "trial 1: log: expected a file below the folder of the run, found \"" + outside +
                  "\"");
  }
  EXPECT_EQ(refusal("UPDATE attribution SET log = ''"), "no error");
  for (const std::string column : {"picture", "video", "track"}) {
    const std::string why = refusal("UPDATE trial SET " + column + " = '/etc/passwd'");
    EXPECT_TRUE(why.starts_with("trial 1: " + column + ": expected")) << why;
    EXPECT_EQ(refusal("UPDATE trial SET " + column + " = ''"), "no error");
  }
}

}  // namespace
}  // namespace segsim::experiments
