// What two machines compare, and what others get of every episode.
#include "experiments/suites/manifest.h"

#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/suites/episode_rows.h"
#include "tests/error_message.h"
#include "tests/experiments/results/table_fixture.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using tests::TemporaryFolder;

/// Thirty trials; "after" has weights of its own in the scene.
results::StoredRun a_stored_run() {
  results::StoredRun stored;
  stored.run = a_run(30);
  stored.run.spec_text = "name: demo\n";
  stored.run.provenance = {{"weights/after/flat", std::string(64, 'e')},
                           {"pool/flat", "train"}};
  stored.scenes = kScenes;
  stored.arms = kArms;
  stored.trials = ten_episodes();
  return stored;
}

TEST(SuiteManifest, HasAHashOfEverythingThatDecides) {
  const suites::Manifest manifest = suites::manifest_of(a_stored_run());
  std::vector<std::string> names;
  for (const auto& [what, sha256] : manifest.hashes) names.push_back(what);
  EXPECT_THAT(names, ElementsAre("suite", "spec", "scene flat", "episodes of flat",
                                 "weights of before", "weights of after in flat", "results"));
  EXPECT_EQ(manifest.suite, "demo");
  EXPECT_EQ(manifest.hash_of("suite"), core::sha256_hex("name: demo\n"));
  EXPECT_EQ(manifest.hash_of("weights of after in flat"), std::string(64, 'e'));
  EXPECT_EQ(manifest.hash_of("nothing"), "");
  results::StoredRun interim = a_stored_run();
  interim.trials.pop_back();
  EXPECT_EQ(suites::manifest_of(interim).hash_of("results"), "");
}

TEST(SuiteManifest, ComesBackFromItsFile) {
  const TemporaryFolder folder("suite_manifest");
  const suites::Manifest written = suites::manifest_of(a_stored_run());
  suites::write_manifest(folder.path() / "m.json", written);
  const suites::Manifest read = suites::read_manifest(folder.path() / "m.json");
  EXPECT_EQ(read.suite, written.suite);
  EXPECT_EQ(read.hashes, written.hashes);
  EXPECT_EQ(read.made_by, written.made_by);
  EXPECT_EQ(read.finished_trials, 30);
  EXPECT_THAT(suites::differences(read, written), IsEmpty());
}

TEST(SuiteManifest, WhatDiffersIsNamedInOneLine) {
  const suites::Manifest a = suites::manifest_of(a_stored_run());
  results::StoredRun other = a_stored_run();
  other.run.code_version = "9.9";  // Who made it does not count.
  other.run.host = "another";
  EXPECT_THAT(suites::differences(a, suites::manifest_of(other)), IsEmpty());
  other.scenes[0].scene_sha256 = std::string(64, 'f');
  other.trials[0].path_m = 5;
  const suites::Manifest b = suites::manifest_of(other);
  EXPECT_THAT(suites::differences(a, b), ElementsAre("scene flat", "results"));
  const std::string message =
      tests::input_error_of([&] { suites::expect_same(a, "out/a", b, "out/b"); });
  EXPECT_THAT(message, AllOf(HasSubstr("out/b: scene flat: expected aaaaaaaaaaaa as in out/a"),
                             HasSubstr("found ffffffffffff; 2 hashes differ in all")));
  EXPECT_EQ(message.find('\n'), std::string::npos);

  suites::Manifest less = a;
  less.hashes.pop_back();
  EXPECT_THAT(suites::differences(a, less), ElementsAre("results"));
  EXPECT_THAT(suites::differences(less, a), ElementsAre("results"));
  less.suite = "homes-v9";
  EXPECT_THAT(tests::input_error_of([&] { suites::expect_same(a, "out/a", less, "out/b"); }),
              AllOf(HasSubstr("expected demo"), HasSubstr("found homes-v9")));
}

TEST(SuiteManifest, OtherFilesAreRefused) {
  const TemporaryFolder folder("suite_manifest_damaged");
  const auto error = [&](const std::string& text) {
    std::ofstream(folder.path() / "m.json") << text;
    return tests::input_error_of(
        [&] { (void)suites::read_manifest(folder.path() / "m.json"); });
  };
  EXPECT_THAT(error("{"), HasSubstr("expected a manifest"));
  EXPECT_THAT(error("{\"schema\": \"segsim.table/1\"}"), HasSubstr("expected a manifest"));
  EXPECT_THAT(error("{\"schema\": \"segsim.suite_manifest/1\", \"suite\": 3}"),
              HasSubstr("expected a whole manifest"));
}

TEST(SuiteEpisodes, EveryTrialIsALineInBothForms) {
  const results::StoredRun stored = a_stored_run();
  std::ostringstream csv, jsonl;
  suites::write_episodes_csv(csv, stored);
  suites::write_episodes_jsonl(jsonl, stored);
  std::istringstream lines(csv.str()), objects(jsonl.str());
  std::string header, line, object;
  std::getline(lines, header);
  EXPECT_THAT(header, testing::StartsWith("suite,scene,pool,episode,goal,arm,training,"));
  int rows = 0;
  for (; std::getline(lines, line); ++rows) {
    ASSERT_TRUE(std::getline(objects, object));
    const auto json = nlohmann::ordered_json::parse(object);
    EXPECT_EQ(json["suite"], "demo");
    EXPECT_EQ(json["pool"], "train");
    EXPECT_THAT(line, HasSubstr(json["episode"].get<std::string>()));
    // Of the weights that decided there, and what they had seen.
    if (json["arm"] == "after") {
      EXPECT_EQ(json["weights_sha256"], std::string(64, 'e'));
      EXPECT_EQ(json["leakage"], "scene");
    }
    EXPECT_TRUE(json["strict_success"].is_null());  // These trials are not attributed.
  }
  EXPECT_EQ(rows, 30);
  EXPECT_FALSE(std::getline(objects, object));
}

}  // namespace
}  // namespace segsim::experiments
