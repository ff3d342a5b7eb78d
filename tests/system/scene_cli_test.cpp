// A scene that nothing drives in, as a user meets it; and one whose training is not finished.
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "experiments/scenes/reconstruct.h"
#include "experiments/training/training_folder.h"
#include "segsim_process.h"
#include "tests/experiments/rendering_only_places.h"
#include "tests/experiments/surfel_recording.h"
#include "tests/experiments/tiny_spec.h"
#include "tests/temporary_folder.h"

namespace segsim::tests {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

class SceneCli : public testing::Test {
 protected:
  SceneCli() {
    experiments::scenes::ReconstructOptions options;
    options.name = "corridor";
    options.lift.voxel_m = 0.04;
    options.lift.min_observations = 2;
    const experiments::SurfelRecording recording(experiments::corridor(),
                                                 experiments::corridor_views());
    (void)experiments::scenes::reconstruct_bundle(recording, options, bundle());
  }

  [[nodiscard]] fs::path bundle() const { return folder_.path() / "tiny"; }
  [[nodiscard]] std::string quoted(const std::string& name) const {
    return "'" + (folder_.path() / name).string() + "'";
  }

  TemporaryFolder folder_;
};

TEST_F(SceneCli, WhatDrivesRefusesInOneLineWithTheReason) {
  experiments::TinySpec spec;
  spec.goals = "box";
  folder_.write("tiny.yaml", spec.text());
  folder_.write("trial.yaml",
                "schema: segsim.trial/1\nscene: tiny\nstart: {pose: [0, 0, 0]}\nsteps:\n  - "
                "hold: {for_s: 1.0}\n");
  for (const std::string& words :
       {"episodes generate " + quoted("tiny") + " -o " + quoted("set.jsonl"),
        "run " + quoted("tiny.yaml") + " --data " + quoted("") + " --work " + quoted("work"),
        "trial run " + quoted("trial.yaml") + " -o " + quoted("trial"),
        "gazebo export-world " + quoted("tiny") + " --out " + quoted("world") +
            " --start 0 0 0",
        "label " + quoted("tiny") + " --out " + quoted("labels"),
        "sensors " + quoted("tiny") + " -o " + quoted("sensors.png"),
        "bench render --scene " + quoted("tiny")}) {
    const ProcessOutput run = run_segsim(words);
    expect_input_error(run, "tiny");
    EXPECT_THAT(run.text,
                HasSubstr("expected a scene to drive in, found one for rendering and labels "
                          "only (no walkable area for jackal-gentle"))
        << words;
    EXPECT_THAT(run.text, HasSubstr("robots that fit: turtlebot3-waffle")) << words;
  }
}

TEST_F(SceneCli, InspectTellsWhyAndNavmeshOpensIt) {
  const ProcessOutput closed = run_segsim("scene inspect " + quoted("tiny"));
  EXPECT_EQ(closed.exit_code, 0) << closed.text;
  EXPECT_THAT(closed.text, HasSubstr("to drive in    no: for rendering and labels only"));
  EXPECT_THAT(closed.text,
              HasSubstr("no walkable area for jackal-gentle (radius 0.33 m, height "
                        "1.25 m, steps of 0.06 m)"));
  EXPECT_THAT(closed.text, HasSubstr("free disc      the largest has a radius of 0.3"));
  EXPECT_THAT(closed.text, HasSubstr("room for       turtlebot3-waffle"));
  // It can be looked at from where it was recorded.
  const ProcessOutput drawn =
      run_segsim("render " + quoted("tiny") + " --view 3 --out " + quoted("view.png"));
  EXPECT_EQ(drawn.exit_code, 0) << drawn.text;
  EXPECT_TRUE(fs::exists(folder_.path() / "view.png"));
  expect_input_error(
      run_segsim("render " + quoted("tiny") + " --view 9999 --out " + quoted("view.png")),
      "--view");

  expect_input_error(run_segsim("scene navmesh " + quoted("tiny")), "room for jackal-gentle");
  // The disk is full: nothing changes, and the next try succeeds.
  const ProcessOutput full =
      run_shell("ulimit -f 0; " + std::string(SEGSIM_BINARY) + " scene navmesh " +
                quoted("tiny") + " --robot turtlebot3-waffle");
  EXPECT_EQ(full.exit_code, 2) << full.text;
  EXPECT_EQ(run_segsim("scene inspect " + quoted("tiny")).text, closed.text);
  const ProcessOutput opened =
      run_segsim("scene navmesh " + quoted("tiny") + " --robot turtlebot3-waffle");
  EXPECT_EQ(opened.exit_code, 0) << opened.text;
  EXPECT_THAT(opened.text, HasSubstr("turtlebot3-waffle can drive there"));
  const ProcessOutput open =
      run_segsim("scene inspect " + quoted("tiny") + " --robot turtlebot3-waffle");
  EXPECT_THAT(open.text, HasSubstr("free space"));
  EXPECT_THAT(open.text, Not(HasSubstr("rendering and labels only")));
  const ProcessOutput world = run_segsim("gazebo export-world " + quoted("tiny") + " --out " +
                                         quoted("world") + " --robot turtlebot3-waffle");
  EXPECT_EQ(world.exit_code, 0) << world.text;
}

TEST_F(SceneCli, AnUnfinishedTrainingCanBeLookedAt) {
  const fs::path work = folder_.path() / "place.training";
  fs::create_directories(work);
  reconstruction::TrainingSet set;
  set.intrinsics = core::CameraIntrinsics::from_fov(64, 48, 1.2);
  for (const core::CameraPose& pose : experiments::wall_views()) {
    set.training.push_back({});
    set.training.back().name = "view";
    set.training.back().T_world_camera = pose;
  }
  expect_input_error(run_segsim("scene inspect " + quoted("place.training")), "scene.yaml");
  experiments::training::write_so_far(work, experiments::walls_alone(), set, {});
  core::write_file_atomically(work / "losses.csv", [](std::ostream& out) {
    out << "stage,iteration,seconds,surfels,loss,value\n"
        << "geometry,120,33.5,4000,color,0.1\n";
  });
  const ProcessOutput told = run_segsim("scene inspect " + quoted("place.training"));
  EXPECT_EQ(told.exit_code, 0) << told.text;
  EXPECT_THAT(told.text, HasSubstr("geometry, iteration 120, 33.5 s"));
  EXPECT_THAT(told.text, HasSubstr("--view 0 --out view.png"));
  const ProcessOutput drawn =
      run_segsim("render " + quoted("place.training") + " --view 0 --out " + quoted("a.png"));
  EXPECT_EQ(drawn.exit_code, 0) << drawn.text;
  EXPECT_TRUE(fs::exists(folder_.path() / "a.png"));
  expect_input_error(run_segsim("render " + quoted("place.training/surfels.ply") +
                                " --view 0 --out " + quoted("b.png")),
                     "--view");
}

}  // namespace
}  // namespace segsim::tests
