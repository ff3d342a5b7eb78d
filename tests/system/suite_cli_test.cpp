// A tiny suite from its file to its page, as a user runs it: three places, four arms,
// trainings of two steps.
#include <algorithm>
#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "core/scene_bundle.h"
#include "renderer/files/ply_io.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/system/segsim_process.h"
#include "tests/temporary_folder.h"

namespace segsim::tests {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr const char* kSuite = R"(schema: segsim.suite/1
name: tiny-v1
title: Three tiny places
about: Two rooms, three times.
data: the bundles a, b, and c
scene: {goals: [couch, chair], episodes: 2, camera_height_m: 1.0}
pools:
  - name: rooms
    scenes:
      - {name: a, bundle: "${data}/a"}
      - {name: b, bundle: "${data}/b"}
      - {name: c, bundle: "${data}/c"}
experiment:
  seed: 3
  detectors:
    before: "SHIPPED"
    finetune: {views_per_scene: 6, steps: 2, width: 64, height: 48, measure_elsewhere: false}
  arms:
    - {name: before, detector: before}
    - {name: after-here, detector: after-here}
    - {name: after-elsewhere, detector: after-elsewhere}
    - {name: oracle, detector: oracle}
  robot: jackal-gentle
  control_period_s: 0.5
  time_limit_s: 4
  camera: {width: 96, height: 72, hfov_deg: 70, pitch_down_deg: 10, depth_range_m: 6}
  pictures: false
)";
constexpr int kTrials = 3 * 2 * 4;

class SuiteCli : public testing::Test {
 protected:
  void SetUp() override {
    const experiments::TinyScene scene;
    float shade = 1.0F;
    for (const char* name : {"a", "b", "c"}) {
      core::SceneManifest manifest = core::load_bundle(scene.write(at(name))).manifest;
      // Other places: names and surfels differ.
      manifest.name = name;
      renderer::SurfelCloud surfels = scene.surfels();
      for (glm::vec3& colour : surfels.sh) colour *= shade;
      renderer::write_surfels_ply(at(name) / "surfels.ply", surfels);
      core::write_bundle_manifest(at(name), manifest);
      shade -= 0.1F;
    }
    write_suite("seed: 3");
  }

  void write_suite(const std::string& seed) const {
    std::string text = kSuite;
    text.replace(text.find("SHIPPED"), 7, SEGSIM_SHIPPED_WEIGHTS);
    text.replace(text.find("seed: 3"), 7, seed);
    std::ofstream(at("tiny-v1.yaml")) << text;
  }

  [[nodiscard]] fs::path at(const std::string& name) const { return folder_.path() / name; }

  [[nodiscard]] ProcessOutput run_suite(const std::string& work,
                                        const std::string& flags) const {
    return run_segsim("suite run " + at("tiny-v1.yaml").string() + " --data " +
                      folder_.path().string() + " --work " + at(work).string() + " " + flags);
  }

  [[nodiscard]] nlohmann::json json(const std::string& file) const {
    return nlohmann::json::parse(core::read_file(at(file)));
  }

  TemporaryFolder folder_{"suite_cli"};
};

TEST_F(SuiteCli, RunsResumesAndIsVerified) {
  const ProcessOutput shown = run_segsim("suite show " + at("tiny-v1.yaml").string());
  EXPECT_EQ(shown.exit_code, 0) << shown.text;
  EXPECT_THAT(shown.text, AllOf(HasSubstr("rooms"), HasSubstr("after-elsewhere")));
  // What it stands for is a spec.
  const ProcessOutput spec = run_segsim("suite show --spec " + at("tiny-v1.yaml").string());
  EXPECT_THAT(spec.text, HasSubstr("schema: segsim.experiment/1\nname: tiny-v1\n"));

  // First some trials, then the rest.
  ProcessOutput run = run_suite("w", "--max-trials 3");
  ASSERT_EQ(run.exit_code, 0) << run.text;
  EXPECT_FALSE(json("w/suite/manifest.json")["hashes"].contains("results"));
  run = run_suite("w", "");
  ASSERT_EQ(run.exit_code, 0) << run.text;
  const nlohmann::json manifest = json("w/suite/manifest.json");
  EXPECT_EQ(manifest["finished_trials"], kTrials);
  for (const char* what :
       {"suite", "scene a", "episodes of b", "weights of before", "weights of after-here in a",
        "weights of after-elsewhere in b", "results"}) {
    EXPECT_TRUE(manifest["hashes"].contains(what)) << what;
  }

  // The page, every trial, and what each arm had seen.
  const std::string page = core::read_file(at("w/suite/index.html"));
  EXPECT_THAT(page, AllOf(HasSubstr("Does it carry over?"), HasSubstr("episodes.csv"),
                          HasSubstr("after-elsewhere")));
  std::istringstream lines(core::read_file(at("w/suite/episodes.jsonl")));
  int rows = 0;
  for (std::string line; std::getline(lines, line); ++rows) {
    const auto row = nlohmann::json::parse(line);
    const std::string arm = row["arm"];
    EXPECT_EQ(row["leakage"], arm == "after-here" ? "scene" : "none") << line;
    EXPECT_EQ(row["pool"], "rooms");
  }
  EXPECT_EQ(rows, kTrials);
  const nlohmann::json table = json("w/table.json");
  EXPECT_EQ(table["after"], "after-here");
  EXPECT_EQ(table["generalisation"].size(), 3U);

  // Its folder and its manifest say the same, also after the page was written again.
  ASSERT_EQ(run_segsim("suite table " + at("w").string()).exit_code, 0);
  run = run_segsim("suite verify " + at("w").string() + " " +
                   at("w/suite/manifest.json").string());
  EXPECT_EQ(run.exit_code, 0) << run.text;
  EXPECT_THAT(run.text, HasSubstr("are the same"));

  // A manifest that does not match is one line.
  nlohmann::ordered_json other =
      nlohmann::ordered_json::parse(core::read_file(at("w/suite/manifest.json")));
  other["hashes"]["scene a"] = std::string(64, '0');
  std::ofstream(at("other.json")) << other;
  run = run_segsim("suite verify " + at("w").string() + " " + at("other.json").string());
  expect_input_error(run, "other.json: scene a");
  EXPECT_EQ(std::count(run.text.begin(), run.text.end(), '\n'), 1) << run.text;

  // Nor does another version go on where this one was run.
  write_suite("seed: 4");
  expect_input_error(run_suite("w", ""), "manifest.json: suite");
}

TEST_F(SuiteCli, MistakesAreOneLine) {
  for (const char* command : {"show", "run"}) {
    const ProcessOutput run = run_segsim(std::string("suite ") + command + " homes-v99");
    expect_input_error(run, "suite");
    EXPECT_THAT(run.text, HasSubstr("homes-v99"));
    EXPECT_EQ(std::count(run.text.begin(), run.text.end(), '\n'), 1) << run.text;
  }
  expect_input_error(run_segsim("suite verify " + at("nowhere").string()), "nowhere");
  expect_input_error(run_segsim("suite table " + at("nowhere").string()), "nowhere");
  expect_input_error(run_segsim("suite verify " + at("a/scene.yaml").string() + ".json"),
                     "scene.yaml.json");
}

TEST(SuiteList, NamesTheSuitesOfTheProgram) {
  const ProcessOutput run =
      run_shell(std::string("cd ") + SEGSIM_ROOT + "; " + SEGSIM_BINARY + " suite list");
  EXPECT_EQ(run.exit_code, 0) << run.text;
  EXPECT_THAT(run.text, AllOf(HasSubstr("homes-v1"), HasSubstr("places-v1")));
}

}  // namespace
}  // namespace segsim::tests
