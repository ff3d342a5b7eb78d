// `segsim gazebo drive` beside a process that moves the robot as Gazebo does.

#include <atomic>
#include <filesystem>
#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/results/stored_run.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/system/gazebo_processes.h"

namespace segsim {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using tests::Process;

constexpr double kPatience_s = 300.0;

class GazeboDrive : public ::testing::Test {
 protected:
  GazeboDrive() : folder_("gazebo_drive"), bundle_(folder_.path() / "bundle") {
    static std::atomic<int> count{0};
    partition_ = "segsim_drive_" + std::to_string(::getpid()) + "_" + std::to_string(++count);
    experiments::TinyScene().write(bundle_);
  }

  std::unique_ptr<Process> physics(const std::vector<std::string>& settings = {}) {
    std::vector<std::string> command = {SEGSIM_GAZEBO_PHYSICS_PEER, "world=tiny"};
    command.insert(command.end(), settings.begin(), settings.end());
    return std::make_unique<Process>(command, partition_, folder_.path() / "physics.txt");
  }

  /// A drive that has ended. @return  Its exit code.
  int drive(const std::vector<std::string>& flags) {
    std::vector<std::string> command = {SEGSIM_BINARY, "gazebo",
                                        "drive",       bundle_.string(),
                                        "--work",      work().string(),
                                        "--backend",   "cpu",
                                        "--width",     "96",
                                        "--height",    "72",
                                        "--most-lag",  "5"};
    command.insert(command.end(), flags.begin(), flags.end());
    Process process(command, partition_, folder_.path() / "drive.txt");
    const int code = process.wait(kPatience_s);
    said_ = process.output();
    return code;
  }

  [[nodiscard]] fs::path work() const { return folder_.path() / "work"; }
  [[nodiscard]] std::vector<experiments::records::TrialRow> rows() const {
    return experiments::results::load_run(work()).trials;
  }

  experiments::TemporaryFolder folder_;
  fs::path bundle_;
  std::string partition_, said_;
};

TEST_F(GazeboDrive, FindsThingsAndLeavesTheRowsOfARun) {
  const auto world = physics();
  ASSERT_EQ(drive({"--goal", "couch,chair", "--episodes", "2", "--policy", "oracle-path",
                   "--time-limit", "60"}),
            0)
      << said_;
  EXPECT_THAT(world->output(), HasSubstr("moved 2"));
  const auto trials = rows();
  ASSERT_EQ(trials.size(), 2U);
  for (const auto& row : trials) {
    EXPECT_TRUE(row.success) << row.episode << ": "
                             << experiments::records::to_string(row.outcome) << "\n"
                             << said_;
    // It drove there: no shorter than the way, and not by our kinematics, which turn in time.
    EXPECT_GT(row.path_m, 0.8 * row.shortest_path_m);
    EXPECT_GT(row.sim_s, row.path_m / 0.6);
  }
  EXPECT_TRUE(fs::exists(work() / "drive.yaml"));
  std::ostringstream table;
  table << std::ifstream(work() / "table.md").rdbuf();
  EXPECT_THAT(table.str(), HasSubstr("moved by Gazebo, world tiny"));
}

/// The same policy, in our kinematics and in Gazebo's physics.
TEST_F(GazeboDrive, FindsThingsInTheWorldThatWasExported) {
#ifndef SEGSIM_HAS_DART
  GTEST_SKIP() << "built without ignition-physics (libignition-physics-dev)";
#endif
  const fs::path exported = folder_.path() / "world";
  Process exporter({SEGSIM_BINARY, "gazebo", "export-world", bundle_.string(), "-o",
                    exported.string(), "--start", "-2", "-1", "0"},
                   partition_, folder_.path() / "export.txt");
  ASSERT_EQ(exporter.wait(60.0), 0) << exporter.output();
  const auto world = physics({"sdf=" + (exported / "world.sdf").string()});
  ASSERT_EQ(drive({"--goal", "couch", "--policy", "frontier", "--time-limit", "90"}), 0)
      << said_ << world->output();
  const auto trials = rows();
  ASSERT_EQ(trials.size(), 1U);
  EXPECT_TRUE(trials.front().success) << said_;
  EXPECT_GT(trials.front().path_m, 1.0);
}

TEST_F(GazeboDrive, SaysWhatIsMissingBeforeAnythingIsMade) {
  EXPECT_EQ(drive({"--goal", "couch", "--wait", "1"}), 2);
  EXPECT_THAT(said_, HasSubstr("Gazebo, world tiny: expected poses of 'jackal' on "
                               "/world/tiny/dynamic_pose/info within 1 s, found none"));
  EXPECT_FALSE(fs::exists(work() / "results.sqlite"));
  EXPECT_EQ(drive({"--goal", "piano", "--wait", "1"}), 2);
  EXPECT_THAT(said_, HasSubstr("--goal: expected couch"));
  const auto world = physics();
  EXPECT_EQ(drive({"--goal", "couch", "--model", "husky", "--wait", "3"}), 2);
  EXPECT_THAT(said_, HasSubstr("found poses of others than 'husky'"));
}

TEST_F(GazeboDrive, AWorldThatBreaksFailsItsTrialWithTheCause) {
  const auto failure = [&](const std::vector<std::string>& settings) {
    const auto world = physics(settings);
    EXPECT_EQ(drive({"--goal", "couch", "--new", "--policy", "frontier", "--wait", "4"}), 1)
        << said_;
    const auto trials = rows();
    return trials.size() == 1 ? trials.front().error : std::string("no row");
  };
  EXPECT_THAT(failure({"fault=freeze"}), HasSubstr("expected poses of 'jackal'"));
  EXPECT_THAT(failure({"fault=set_back"}), HasSubstr("a clock that goes on"));
  EXPECT_THAT(failure({"fault=fall"}), HasSubstr("on its wheels, found one that fell over"));
  EXPECT_THAT(failure({"service=off"}), HasSubstr("the service /world/tiny/set_pose"));
}

TEST_F(GazeboDrive, ASpecThatCannotBeIsRefused) {
  const auto refusal = [&](const std::string& more) {
    const fs::path file = folder_.path() / "spec.yaml";
    std::ofstream(file)
        << "schema: segsim.experiment/1\nname: x\nscenes:\n  - {name: s, bundle: "
        << bundle_.string()
        << ", goals: [couch], episodes: 1}\n"
           "arms:\n  - {name: a, detector: oracle}\n"
        << more;
    Process process({SEGSIM_BINARY, "run", file.string(), "--work", work().string()},
                    partition_, folder_.path() / "run.txt");
    EXPECT_EQ(process.wait(60.0), 2);
    return process.output();
  };
  const std::string motion = "motion: {type: gazebo, world: tiny}\n";
  EXPECT_THAT(refusal(motion), HasSubstr("clock: {mode: realtime}"));
  EXPECT_THAT(refusal(motion + "clock: {mode: realtime}\ncollision: navmesh\n"),
              HasSubstr("collision: footprint"));
  EXPECT_THAT(refusal(motion + "clock: {mode: realtime}\nreplays: {of: all}\n"),
              HasSubstr("of: none"));
  EXPECT_THAT(refusal(motion + "clock: {mode: realtime}\n"),
              HasSubstr("--workers 1, because a world has one robot"));
}

}  // namespace
}  // namespace segsim
