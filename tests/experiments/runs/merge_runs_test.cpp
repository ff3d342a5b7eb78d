#include "experiments/runs/merge_runs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "experiments/records/results_digest.h"
#include "experiments/results/stored_run.h"
#include "tests/error_message.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

records::RunRow a_run() {
  records::RunRow run;
  run.name = run.title = "demo";
  run.spec_sha256 = "aa";
  run.code_version = "0.1";
  run.host = "h";
  run.success_profile = "p";
  run.planned_trials = 12;
  return run;
}

const std::vector<records::SceneRow> kScenes{{"room", "Room", "s", "e", 6}};
const std::vector<records::ArmRow> kArms{{"before", "a", "wa", "", -1, {}},
                                         {"after", "b", "wb", "", -1, {}}};

records::TrialRow a_trial(int episode, const std::string& arm) {
  records::TrialRow trial;
  trial.arm = arm;
  trial.scene = "room";
  trial.goal_class = "couch";
  trial.episode = "room/couch/" + std::to_string(episode);
  trial.success = arm == "after" || episode == 0;
  trial.outcome =
      trial.success ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
  trial.spl = 1.0 / (3.0 + episode);
  trial.state_hash = 0x1234567890abcdefULL + static_cast<std::uint64_t>(episode);
  trial.wall_s = 0.1 * episode;
  trial.why.cause = trial.success ? records::Cause::kDidNotFail : records::Cause::kStuck;
  trial.log = "logs/" + trial.episode + "." + arm + ".json.gz";
  return trial;
}

class MergeRuns : public testing::Test {
 protected:
  /// A store with trials of the given episodes, both arms, and a log of each.
  fs::path part(const std::string& name, const std::vector<int>& episodes,
                const records::RunRow& run = a_run(),
                const std::vector<records::SceneRow>& scenes = kScenes,
                const std::vector<records::ArmRow>& arms = kArms) {
    const fs::path folder = folder_.path() / name;
    records::Store store(folder / "results.sqlite");
    records::RunRow named = run;
    named.provenance["shard"] = name;
    const std::int64_t id = store.begin_run(named, scenes, arms);
    for (const int episode : episodes) {
      for (const records::ArmRow& arm : kArms) {
        const records::TrialRow trial = a_trial(episode, arm.name);
        folder_.write(name + "/" + trial.log, "log of " + trial.episode);
        store.add_trial(id, trial);
      }
    }
    return folder;
  }
  [[nodiscard]] fs::path out() const { return folder_.path() / "out"; }
  [[nodiscard]] std::string digest() const {
    return records::results_sha256(results::load_run(out()).trials);
  }
  runs::MergeReport merge(const std::vector<fs::path>& shards) const {
    return runs::merge_runs(out(), shards);
  }
  std::string refusal(const std::vector<fs::path>& shards) const {
    return tests::input_error_of([&] { (void)merge(shards); });
  }

  tests::TemporaryFolder folder_;
};

TEST_F(MergeRuns, PartsMakeTheWhole) {
  const fs::path whole = part("whole", {0, 1, 2, 3, 4, 5});
  const fs::path a = part("0-of-2", {0, 2, 4}), b = part("1-of-2", {1, 3, 5});
  EXPECT_EQ(merge({a}).added, 6);
  EXPECT_TRUE(results::load_run(out()).run.ended.empty());
  const runs::MergeReport report = merge({b, a});
  EXPECT_EQ(report.added, 6);
  EXPECT_EQ(report.known, 6);
  EXPECT_EQ(report.table.finished_trials, 12);
  EXPECT_EQ(report.results_sha256, records::results_sha256(results::load_run(whole).trials));
  const results::StoredRun merged = results::load_run(out());
  EXPECT_FALSE(merged.run.ended.empty());
  EXPECT_EQ(merged.run.provenance.count("shard"), 0U);
  EXPECT_THAT(merged.run.provenance.at("merged/0-of-2"), HasSubstr("h: 6 trials"));
  EXPECT_EQ(merged.trials[3].finished, results::load_run(b).trials[1].finished);
  for (const records::TrialRow& trial : merged.trials) {
    EXPECT_EQ(core::read_file(out() / trial.log), "log of " + trial.episode);
  }
  EXPECT_TRUE(fs::exists(out() / "table.md"));
}

TEST_F(MergeRuns, AgainAndTwiceChangesNothing) {
  const fs::path a = part("a", {0, 1, 2}), b = part("b", {2, 3});
  EXPECT_EQ(merge({a, b, a}).added, 8);
  const std::string before = digest();
  const runs::MergeReport again = merge({b, b, a});
  EXPECT_EQ(again.added, 0);
  EXPECT_EQ(again.known, 14);
  EXPECT_EQ(digest(), before);
  EXPECT_EQ(results::load_run(out()).trials.size(), 8U);
}

TEST_F(MergeRuns, TheOrderOfShardsDoesNotMatter) {
  const fs::path a = part("a", {0, 3}), b = part("b", {1, 2});
  const auto ids = [&] {
    std::string text;
    for (const records::TrialRow& t : results::load_run(out()).trials)
      text += std::to_string(t.trial_id) + " ";
    return text;
  };
  (void)merge({a, b});
  const std::string first = ids() + digest();
  fs::remove_all(out());
  (void)merge({b, a});
  EXPECT_EQ(ids() + digest(), first);
}

/// The essence of a trial: what may differ is time and place.
TEST_F(MergeRuns, ConflictsAreRefusedAndNothingIsChanged) {
  const fs::path a = part("a", {0, 1}), b = part("b", {1, 2});
  (void)merge({a});
  const std::string before = digest();
  {
    records::Store store(b / "results.sqlite");
    records::TrialRow other = a_trial(5, "after");
    other.wall_s = 99.0;
    store.add_trial(1, other);
  }
  const fs::path c = part("c", {5});  // Another wall time is no conflict.
  EXPECT_EQ(merge({b, c}).table.finished_trials, 8);
  const std::string whole = digest();
  EXPECT_NE(whole, before);

  const fs::path d = part("d", {4});
  {
    records::Store store(d / "results.sqlite");
    records::TrialRow other = a_trial(0, "before");
    other.state_hash ^= 1U;
    store.add_trial(1, other);
  }
  EXPECT_THAT(refusal({d}),
              testing::AllOf(HasSubstr("room/couch/0"), HasSubstr("before"),
                             HasSubstr("1234567890abcdef"), HasSubstr("1234567890abcdee")));
  EXPECT_EQ(digest(), whole);
  EXPECT_FALSE(fs::exists(out() / "logs/room/couch/4.after.json.gz"));
}

TEST_F(MergeRuns, AFinishedTrialTakesThePlaceOfAFailedOne) {
  const fs::path a = part("a", {1}), b = part("b", {0});
  {
    records::Store store(a / "results.sqlite");
    records::TrialRow failed = a_trial(0, "before");
    failed.outcome = records::TrialOutcome::kError;
    failed.error = "no memory";
    store.add_trial(1, failed);
  }
  EXPECT_EQ(merge({a}).failed, 1);
  EXPECT_EQ(merge({a, b}).added, 2);
  const std::string good = digest();
  EXPECT_EQ(merge({a}).added, 0);  // And does not come back.
  EXPECT_EQ(digest(), good);
  for (const records::TrialRow& trial : results::load_run(out()).trials)
    EXPECT_FALSE(trial.failed());
}

TEST_F(MergeRuns, WhatDoesNotBelongTogetherIsRefused) {
  const fs::path a = part("a", {0});
  (void)merge({a});
  records::RunRow run = a_run();
  run.spec_sha256 = "bb";
  EXPECT_THAT(refusal({a, part("spec", {1}, run)}), HasSubstr("spec"));
  EXPECT_THAT(refusal({folder_.path() / "spec"}), HasSubstr("spec"));  // Than what is there.
  run = a_run();
  run.code_version = "0.2";
  EXPECT_THAT(refusal({part("version", {1}, run)}),
              HasSubstr("expected segsim 0.1, found 0.2"));
  EXPECT_THAT(refusal({part("scene", {1}, a_run(), {{"room", "Room", "t", "e", 6}})}),
              HasSubstr("scene room"));
  EXPECT_THAT(refusal({part("episodes", {1}, a_run(), {{"room", "Room", "s", "f", 6}})}),
              HasSubstr("episodes of scene room"));
  std::vector<records::ArmRow> arms = kArms;
  arms[1].weights_sha256 = "wc";
  EXPECT_THAT(refusal({part("weights", {1}, a_run(), kScenes, arms)}),
              HasSubstr("weights of arm after"));
  EXPECT_THAT(refusal({folder_.path() / "nothing"}), HasSubstr("nothing"));
  EXPECT_THAT(refusal({}), HasSubstr("shards"));
  EXPECT_EQ(results::load_run(out()).trials.size(), 2U);
}

TEST_F(MergeRuns, ShardsOfAFolderAreFound) {
  const fs::path b = part("out/shards/1-of-2", {1}), a = part("out/shards/0-of-2", {0});
  fs::create_directories(out() / "shards" / "empty");
  EXPECT_EQ(runs::shard_folders(out()), (std::vector<fs::path>{a, b}));
  EXPECT_TRUE(runs::shard_folders(folder_.path()).empty());
  // Leftovers of killed processes stay where they are.
  folder_.write("out/shards/0-of-2/logs/.x.tmp7.gz", "half");
  EXPECT_EQ(merge(runs::shard_folders(out())).added, 4);
  EXPECT_FALSE(fs::exists(out() / "logs/.x.tmp7.gz"));
}

}  // namespace
}  // namespace segsim::experiments
