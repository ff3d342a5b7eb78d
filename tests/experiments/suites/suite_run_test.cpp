// A tiny suite through the whole of a run: three places, detectors tuned here and elsewhere.
#include <algorithm>
#include <map>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "core/scene_bundle.h"
#include "experiments/report/suite_page.h"
#include "experiments/results/stored_run.h"
#include "experiments/runs/merge_runs.h"
#include "experiments/runs/run.h"
#include "experiments/suites/manifest.h"
#include "experiments/suites/suite.h"
#include "perception/data/dataset.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr const char* kSuite = R"(schema: segsim.suite/1
name: tiny-v1
title: Three tiny places
about: Two rooms, three times.
data: the bundles a, b, and c
scene: {goals: [couch, chair], episodes: 2, camera_height_m: 1.0}
pools:
  - name: train
    scenes:
      - {name: a, bundle: "${data}/a"}
      - {name: b, bundle: "${data}/b"}
  - name: unseen
    scenes:
      - {name: c, bundle: "${data}/c"}
experiment:
  seed: 3
  detectors:
    before: "SHIPPED"
    finetune: {pools: [train], views_per_scene: 6, steps: 2, width: 64, height: 48,
      measure_elsewhere: false}
  arms:
    - {name: before, detector: before}
    - {name: after-here, detector: after-here}
    - {name: after-elsewhere, detector: after-elsewhere}
    - {name: oracle, detector: oracle}
  robot: jackal-gentle
  control_period_s: 0.5
  time_limit_s: 3
  camera: {width: 64, height: 48, hfov_deg: 70, pitch_down_deg: 10, depth_range_m: 6}
  pictures: false
)";
constexpr int kTrials = 3 * 2 * 4;

class SuiteRun : public testing::Test {
 protected:
  void SetUp() override {
    const TinyScene scene;
    float shade = 1.0F;
    for (const char* name : {"a", "b", "c"}) {
      core::SceneManifest manifest =
          core::load_bundle(scene.write(folder_.path() / name)).manifest;
      // Other places: names and surfels differ.
      manifest.name = name;
      renderer::SurfelCloud surfels = scene.surfels();
      for (glm::vec3& colour : surfels.sh) colour *= shade;
      renderer::write_surfels_ply(folder_.path() / name / "surfels.ply", surfels);
      core::write_bundle_manifest(folder_.path() / name, manifest);
      shade -= 0.1F;
    }
    std::string text = kSuite;
    text.replace(text.find("SHIPPED"), 7, SEGSIM_SHIPPED_WEIGHTS);
    suite_ = suites::parse_suite(text, "tiny-v1.yaml");
  }

  runs::RunReport run(const std::string& work, std::optional<runs::Shard> shard = {}) {
    runs::RunOptions options;
    options.folders = {folder_.path(), folder_.path() / work};
    options.shard = shard;
    return runs::run_experiment(
        specs::parse_spec(suite_.spec_text, suite_.spec_origin(), options.folders), options);
  }

  TemporaryFolder folder_{"suite_run"};
  suites::Suite suite_;
};

TEST_F(SuiteRun, TellsForEveryArmWhatItHadSeenWhereItRan) {
  const runs::RunReport report = run("w");
  EXPECT_EQ(report.trials_run, kTrials);
  EXPECT_EQ(report.trials_failed, 0);
  const fs::path work = folder_.path() / "w";

  // One detector for each scene, one for each scene that is left out, one for the whole pool.
  for (const char* file : {"detector-after.here-a.bin", "detector-after.here-b.bin",
                           "detector-after.here-c.bin", "detector-after.without-a.bin",
                           "detector-after.without-b.bin", "detector-after.pool.bin"}) {
    EXPECT_TRUE(fs::exists(work / file)) << file;
  }
  EXPECT_FALSE(fs::exists(work / "detector-after.bin"));
  // Views are drawn once and put together.
  const perception::CocoDataset pool = perception::read_coco(work / "views/pool/train.json");
  ASSERT_EQ(pool.images.size(), 12U);
  EXPECT_TRUE(fs::exists(pool.image_file(pool.images.front())));
  EXPECT_TRUE(fs::exists(pool.image_file(pool.images.back())));
  EXPECT_EQ(pool.scenes->size(), 2U);

  std::map<std::string, records::ArmRow> arms;
  for (const records::ArmRow& arm : report.table.arm_rows) arms[arm.name] = arm;
  EXPECT_THAT(arms["after-here"].exposure->trained_on, ElementsAre("a", "b", "c"));
  EXPECT_THAT(arms["after-elsewhere"].exposure->trained_on, IsEmpty());
  // Nor is a threshold chosen where the detector is judged.
  EXPECT_THAT(arms["after-here"].exposure->threshold_on, ElementsAre("a", "b", "c"));
  EXPECT_THAT(arms["after-elsewhere"].exposure->threshold_on, IsEmpty());
  EXPECT_THAT(arms["before"].exposure->threshold_on, ElementsAre("a", "b"));
  EXPECT_EQ(arms["after-elsewhere"].tuned_on, "");
  EXPECT_EQ(arms["after-here"].tuned_on, "a, b, c");
  EXPECT_EQ(arms["after-elsewhere"].detector, "3 files for 3 scenes");
  EXPECT_TRUE(arms["after-elsewhere"].held_out.has_value());

  EXPECT_EQ(report.table.pools.size(), 2U);
  EXPECT_EQ(report.table.generalisation.size(), 9U);
  EXPECT_THAT(report.table.notes,
              Contains(HasSubstr("Leakage none: \"after-elsewhere\" has weights of their own "
                                 "in every scene")));
}

TEST_F(SuiteRun, IsTheSameInPartsAndMakesAPage) {
  (void)run("w");
  (void)run("parts", runs::Shard{0, 2});
  (void)run("parts", runs::Shard{1, 2});
  const fs::path parts = folder_.path() / "parts";
  (void)runs::merge_runs(parts, runs::shard_folders(parts));
  const results::StoredRun whole = results::load_run(folder_.path() / "w");
  const results::StoredRun merged = results::load_run(parts);
  const suites::Manifest manifest = suites::manifest_of(whole);
  EXPECT_THAT(suites::differences(manifest, suites::manifest_of(merged)), IsEmpty());
  EXPECT_EQ(manifest.hash_of("suite"), suite_.sha256());
  EXPECT_EQ(manifest.finished_trials, kTrials);
  EXPECT_NE(manifest.hash_of("weights of after-here in a"),
            manifest.hash_of("weights of after-here in b"));

  const fs::path page = report::write_suite_page(merged, parts / "suite");
  EXPECT_THAT(core::read_file(page),
              AllOf(HasSubstr("Does it carry over?"), HasSubstr("episodes.csv"),
                    HasSubstr("Pool unseen (1 scene)"), HasSubstr(suite_.sha256())));
  std::istringstream lines(core::read_file(parts / "suite/episodes.jsonl"));
  int rows = 0;
  for (std::string line; std::getline(lines, line); ++rows) {
    const auto row = nlohmann::json::parse(line);
    EXPECT_EQ(row["leakage"], row["arm"] == "after-here" ? "scene" : "none") << line;
    EXPECT_EQ(row["pool"], row["scene"] == "c" ? "unseen" : "train");
  }
  EXPECT_EQ(rows, kTrials);
}

}  // namespace
}  // namespace segsim::experiments
