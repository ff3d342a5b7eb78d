// Runs whose policies and detectors live in other processes.
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/results/stored_run.h"
#include "experiments/runs/run.h"
#include "experiments/specs/spec.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

bool python_does(const std::string& statement) {
  return std::system(("python3 -c '" + statement + "' >/dev/null 2>&1").c_str()) == 0;
}

class PeerRun : public testing::Test {
 protected:
  void SetUp() override { TinyScene().write(folder_.path() / "tiny"); }

  runs::RunReport run(const std::string& arms, int workers = 1, double time_limit_s = 30.0) {
    runs::RunOptions options;
    options.workers = workers;
    options.folders = {folder_.path(), folder_.path() / "work"};
    const TinySpec spec{.episodes = 2,
                        .arms = arms,
                        .time_limit_s = time_limit_s,
                        .more = "policy: frontier\npictures: false\n"};
    return runs::run_experiment(
        specs::parse_spec(spec.text(), folder_.path() / "tiny.yaml", options.folders),
        options);
  }

  /// Trials by arm, in the order of episodes.
  [[nodiscard]] std::map<std::string, std::vector<records::TrialRow>> trials() const {
    std::map<std::string, std::vector<records::TrialRow>> by_arm;
    for (const records::TrialRow& trial : results::load_run(folder_.path() / "work").trials) {
      by_arm[trial.arm].push_back(trial);
    }
    return by_arm;
  }

  static std::string stage(const std::string& word) {
    return "{type: process, command: [" PEER_STAGE ", " + word + "]}";
  }

  TemporaryFolder folder_;
};

TEST_F(PeerRun, APolicyInAProcessDrivesAsItDoesInside) {
  const runs::RunReport report =
      run("  - {name: before, detector: oracle}\n"
          "  - {name: after, detector: oracle, policy: " +
              stage("frontier") + "}\n",
          2);
  EXPECT_EQ(report.trials_failed, 0);
  const auto by_arm = trials();
  for (std::size_t k = 0; k < 2; ++k) {
    const records::TrialRow &inside = by_arm.at("before")[k], &outside = by_arm.at("after")[k];
    EXPECT_GT(inside.ticks, 0);
    EXPECT_EQ(inside.state_hash, outside.state_hash);
    EXPECT_EQ(inside.outcome, outside.outcome);
    EXPECT_EQ(inside.path_m, outside.path_m);
  }
}

TEST_F(PeerRun, AProcessThatEndsFailsItsTrialAndNoOther) {
  const runs::RunReport report =
      run("  - {name: before, detector: oracle}\n"
          "  - {name: after, detector: oracle, policy: " +
          stage("crash") + "}\n");
  EXPECT_EQ(report.trials_failed, 2);
  const auto by_arm = trials();
  for (const records::TrialRow& trial : by_arm.at("after")) {
    EXPECT_EQ(trial.outcome, records::TrialOutcome::kError);
    EXPECT_THAT(trial.error, HasSubstr("that it ended with exit code 9"));
  }
  for (const records::TrialRow& trial : by_arm.at("before")) EXPECT_FALSE(trial.failed());
}

TEST_F(PeerRun, ADetectorInAProcessHasSeenNobodyKnowsWhat) {
  (void)run("  - {name: before, detector: " + stage("blind") +
            "}\n"
            "  - {name: after, detector: oracle}\n");
  const results::StoredRun stored = results::load_run(folder_.path() / "work");
  ASSERT_EQ(stored.arms.size(), 2U);
  EXPECT_NE(stored.arms[0].weights_sha256, "");
  EXPECT_THAT(stored.arms[0].detector, HasSubstr("blind"));
  EXPECT_EQ(records::exposure_text(stored.arms[0].exposure.value()), "unknown");
  const auto by_arm = trials();
  ASSERT_EQ(by_arm.at("before").size(), 2U);
  for (const records::TrialRow& trial : by_arm.at("before")) {
    EXPECT_FALSE(trial.failed()) << trial.error;
    EXPECT_FALSE(trial.success);
    EXPECT_EQ(trial.first_detected_tick, -1);
  }
}

TEST_F(PeerRun, TheExamplesReachTheirGoals) {
  if (!python_does("pass")) GTEST_SKIP() << "no python3";
  const runs::RunReport report =
      run("  - {name: before, detector: oracle, policy: {type: process, command: "
          "[python3, " SEGSIM_EXAMPLES
          "/peer_policy.py]}}\n"
          "  - {name: after, detector: oracle, policy: {type: process, command: "
          "[" PEER_POLICY "]}}\n",
          1, 180.0);
  EXPECT_EQ(report.trials_failed, 0);
  const auto by_arm = trials();
  ASSERT_EQ(by_arm.size(), 2U);
  for (const auto& [arm, rows] : by_arm) {
    const auto is_success = [](const records::TrialRow& trial) { return trial.success; };
    EXPECT_GE(std::count_if(rows.begin(), rows.end(), is_success), 1) << arm;
  }
}

/// From the root of the repository the module that serves classes is found.
struct InSourceFolder {
  fs::path before = fs::current_path();
  InSourceFolder() { fs::current_path(SEGSIM_SOURCE); }
  ~InSourceFolder() { fs::current_path(before); }
};

TEST_F(PeerRun, AChangedScriptIsAnotherPolicy) {
  if (!python_does("pass")) GTEST_SKIP() << "no python3";
  const fs::path script = folder_.path() / "mine.py";
  fs::copy_file(SEGSIM_EXAMPLES "/peer_policy.py", script);
  const std::string arms =
      "  - {name: before, detector: oracle}\n"
      "  - {name: after, detector: oracle, policy: {type: process, command: "
      "[python3, '${spec}/mine.py']}}\n";
  EXPECT_EQ(run(arms).trials_run, 4);
  EXPECT_EQ(run(arms).trials_run, 0);  // All is done.
  std::ofstream(script, std::ios::app) << "# another\n";
  EXPECT_THAT(tests::input_error_of([&] { (void)run(arms); }),
              HasSubstr("program/after/mine.py: expected the file that the run began with"));
}

TEST_F(PeerRun, AClassOfAPythonModuleIsAPolicyOrADetector) {
  if (!python_does("import numpy")) {
    GTEST_SKIP() << "python3 has no NumPy";
  }
  std::ofstream(folder_.path() / "mine.py") <<
      R"(from fastsegsim.peer import Decision, Detection


class Spin:
    def reset(self, episode):
        assert episode.goal == "couch" and "couch" in episode.class_names, episode
        assert abs(episode.camera_height_m - 1.0) < 1e-9 and episode.robot["length_m"] > 0.1

    def decide(self, seen, detections):
        print("printed by the policy")
        assert seen.rgb.shape == (72, 96, 3) and seen.depth_m.dtype == "float32"
        assert seen.K[0, 2] == 48 and abs(seen.T_robot_camera[2, 3] - 1.0) < 1e-9
        assert all(d.class_name == "couch" and d.score == 0.75 for d in detections)
        return Decision(turn_radps=0.5, stop="nothing_new" if seen.time_s > 2 else None)


class Sees:
    def __init__(self, goals):
        self.class_names = goals

    def detect(self, seen):
        return [Detection(0, 0.75, (1, 2, 30, 40))]
)";
  const InSourceFolder here;
  const runs::RunReport report =
      run("  - {name: before, detector: oracle}\n"
          "  - {name: after, detector: 'python:mine:Sees', policy: 'python:mine:Spin'}\n");
  EXPECT_THAT(tests::input_error_of([&] {
                (void)run("  - {name: after, detector: oracle, policy: 'python:mine:Jump'}\n");
              }),
              HasSubstr("ended with exit code 1"));
  EXPECT_EQ(report.trials_failed, 0);
  const auto by_arm = trials();
  ASSERT_EQ(by_arm.at("after").size(), 2U);
  for (const records::TrialRow& trial : by_arm.at("after")) {
    EXPECT_EQ(trial.error, "");
    EXPECT_EQ(trial.stop_reason, core::StopReason::kNothingNew);
  }
}

TEST_F(PeerRun, WhatCannotBeStartedEndsTheRunBeforeAnyTrial) {
  EXPECT_THAT(tests::input_error_of([&] {
                (void)run(
                    "  - {name: after, detector: oracle, policy: {type: process, command: "
                    "[/no/such/program]}}\n");
              }),
              HasSubstr("/no/such/program: expected a program that can be started"));
  EXPECT_THAT(tests::input_error_of([&] {
                (void)run("  - {name: after, detector: {type: process, command: [" PEER_STAGE
                          ", frontier]}}\n");
              }),
              HasSubstr("it ended with exit code 2"));
  EXPECT_THAT(tests::input_error_of([&] {
                (void)run(
                    "  - {name: after, score_threshold: 0.5, detector: {type: process, "
                    "command: [" PEER_STAGE ", blind]}}\n");
              }),
              HasSubstr("score_threshold: expected none"));
  EXPECT_THAT(tests::input_error_of([&] {
                (void)run("  - {name: after, detector: {type: proces, command: [a]}}\n");
              }),
              HasSubstr("process"));
}

}  // namespace
}  // namespace segsim::experiments
