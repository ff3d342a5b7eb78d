#include "experiments/specs/spec.h"

#include <algorithm>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/specs/home_spec.h"
#include "nav/policies/built_in_policies.h"

namespace segsim::experiments {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

const char* const kSpec = R"(schema: segsim.experiment/1
name: two-flats
title: Two flats
seed: 7
scenes:
  - name: flat-1
    title: Flat 1
    source: {type: flat, seed: 11, voxel_m: 0.03, capture: {frames: 90, width: 320, height: 240}}
    goals: [chair, couch]
    episodes: 6
    camera_height_m: 1.1
  - name: office
    source: {type: rgbd, folder: "${data}/office", boxes: "${spec}/boxes.json", frame_step: 2}
    goals: [chair]
    start_distance_m: [1.5, 8]
detectors:
  pretrain: {rooms: 3, views_per_room: 5, steps: 40}
  finetune: {scenes: [flat-1], views_per_scene: 30, steps: 50, mix_share: 0.25, start_clearance_m: 0.5}
arms:
  - {name: before, detector: before}
  - {name: after, detector: after, score_threshold: 0.4}
  - {name: oracle, detector: oracle}
  - {name: other, detector: "${data}/other.bin"}
robot: jackal-gentle
control_period_s: 0.2
camera: {width: 160, height: 120, hfov_deg: 80, pitch_down_deg: 10, depth_range_m: 5, backend: auto}
success: {profile: segsim-object, distance_m: 0.8, visible_pixels: 25}
planned_n: 6
videos: first
)";

specs::ExperimentSpec parse(const std::string& text, specs::SpecFolders folders = {"/d", ""}) {
  return specs::parse_spec(text, "specs/two.yaml", folders);
}

/// The message of the error that a spec causes; empty if it causes none.
std::string error_of(const std::string& text, const specs::SpecFolders& folders = {"/d", ""}) {
  try {
    (void)parse(text, folders);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return {};
}

std::string with(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(Spec, EveryFieldIsRead) {
  specs::SpecFolders folders{"/d", ""};
  const specs::ExperimentSpec spec = specs::parse_spec(kSpec, "specs/two.yaml", folders);
  EXPECT_EQ(folders.work, "out/two-flats");
  EXPECT_EQ(spec.name, "two-flats");
  EXPECT_EQ(spec.seed, 7U);
  ASSERT_EQ(spec.scenes.size(), 2U);

  const specs::SceneSpec& flat = spec.scenes[0];
  EXPECT_EQ(flat.title, "Flat 1");
  EXPECT_EQ(flat.bundle, "out/two-flats/scenes/flat-1");
  ASSERT_TRUE(flat.source.has_value());
  EXPECT_EQ(flat.source->type, specs::SourceType::kFlat);
  EXPECT_EQ(flat.source->seed, 11U);
  EXPECT_EQ(flat.source->capture.frames, 90);
  EXPECT_EQ(flat.source->capture.width_px, 320);
  EXPECT_DOUBLE_EQ(flat.source->voxel_m, 0.03);
  EXPECT_THAT(flat.goals, ElementsAre("chair", "couch"));
  EXPECT_EQ(flat.episodes, 6);
  EXPECT_DOUBLE_EQ(flat.camera_height_m, 1.1);

  const specs::SceneSpec& office = spec.scenes[1];
  EXPECT_EQ(office.title, "office");
  EXPECT_EQ(office.source->folder, "/d/office");
  EXPECT_EQ(office.source->boxes, "specs/boxes.json");
  EXPECT_EQ(office.source->frame_step, 2);
  EXPECT_DOUBLE_EQ(office.min_start_distance_m, 1.5);
  EXPECT_DOUBLE_EQ(office.max_start_distance_m, 8.0);

  EXPECT_EQ(spec.detectors.before, "out/two-flats/detector-before.bin");
  EXPECT_EQ(spec.detectors.pretrain->rooms, 3);
  EXPECT_EQ(spec.detectors.finetune->views_per_scene, 30);
  EXPECT_EQ(spec.detectors.finetune->mix_share, 0.25);
  EXPECT_EQ(spec.detectors.finetune->mix_rooms, 100);
  EXPECT_EQ(spec.detectors.finetune->start_clearance_m, 0.5);
  ASSERT_EQ(spec.arms.size(), 4U);
  EXPECT_EQ(spec.arms[0].detector, specs::ArmDetector::kBefore);
  EXPECT_DOUBLE_EQ(spec.arms[1].score_threshold.value(), 0.4);
  EXPECT_EQ(spec.arms[2].detector, specs::ArmDetector::kOracle);
  EXPECT_EQ(spec.arms[3].weights, "/d/other.bin");
  EXPECT_EQ(spec.robot.name, "jackal-gentle");
  EXPECT_EQ(spec.camera.intrinsics().width_px, 160);
  EXPECT_EQ(spec.camera.backend, renderer::Backend::kAuto);
  EXPECT_NEAR(spec.camera.intrinsics().horizontal_fov_rad(), 80.0 * 3.14159265 / 180.0, 1e-6);
  EXPECT_EQ(spec.success.visible_pixels, 25);
  EXPECT_EQ(spec.planned_n, 6);
  EXPECT_EQ(spec.videos, specs::Recorded::kFirst);
}

TEST(Spec, FramesAreRecordedOnRequest) {
  EXPECT_EQ(parse(kSpec).frames.of, specs::Recorded::kNone);
  const std::string text(kSpec);
  specs::FramesSpec frames = parse(text + "frames: {of: all}\n").frames;
  EXPECT_EQ(frames.of, specs::Recorded::kAll);
  EXPECT_EQ(frames.every_s, 1.0);
  frames = parse(text + "frames: {of: first, every_s: 0.4}\n").frames;
  EXPECT_EQ(frames.of, specs::Recorded::kFirst);
  EXPECT_EQ(frames.every_s, 0.4);
  EXPECT_THAT(error_of(text + "frames: {every_s: 1}\n"), HasSubstr("of"));
  EXPECT_THAT(error_of(text + "frames: {of: most}\n"), HasSubstr("none | first | all"));
  EXPECT_THAT(error_of(text + "frames: {of: all, every_s: 0}\n"),
              HasSubstr("a number in [0.005, 3600]"));
  EXPECT_THAT(error_of(text + "frames: {of: all, every: 1}\n"), HasSubstr("every_s"));
}

TEST(Spec, WhatMotionIsCheckedAgainst) {
  specs::SpecFolders folders;
  folders.data = "data";
  EXPECT_EQ(specs::parse_spec(kSpec, "two.yaml", folders).collision,
            sim::CollisionMode::kFootprint);
  const std::string text = std::string(kSpec) + "collision: navmesh\n";
  EXPECT_EQ(specs::parse_spec(text, "two.yaml", folders).collision,
            sim::CollisionMode::kNavmesh);
}

TEST(Spec, SuccessProfilesByName) {
  const std::string line =
      "success: {profile: segsim-object, distance_m: 0.8, visible_pixels: 25}";
  const auto profile = [&](const std::string& fields) {
    return with(kSpec, line, "success: {" + fields + "}");
  };
  EXPECT_DOUBLE_EQ(parse(kSpec).success.rule().distance_m, 0.8);
  const specs::SuccessSpec habitat = parse(profile("profile: habitat-hm3d")).success;
  EXPECT_EQ(habitat.rule(), *sim::find_success_profile("habitat-hm3d"));
  EXPECT_DOUBLE_EQ(habitat.distance_m, 0.1);
  EXPECT_FALSE(habitat.require_visible);
  // A rule with another number is not the rule of that name.
  EXPECT_THAT(error_of(profile("profile: habitat-hm3d, distance_m: 0.3")),
              AllOf(HasSubstr("distance_m"), HasSubstr("0.1 m")));
  EXPECT_THAT(error_of(profile("profile: barn, require_visible: true")),
              HasSubstr("require_visible"));
  EXPECT_THAT(error_of(profile("profile: habitat-hm3")), HasSubstr("near: habitat-hm3d"));
}

TEST(Spec, AnEpisodeFileTakesThePlaceOfRules) {
  const std::string rules = "goals: [chair, couch]\n    episodes: 6\n";
  const specs::ExperimentSpec spec =
      parse(with(kSpec, rules, "episode_file: ${data}/set.jsonl\n    allow_trivial: true\n"));
  EXPECT_EQ(spec.scenes[0].episode_file, "/d/set.jsonl");
  EXPECT_TRUE(spec.scenes[0].allow_trivial);
  EXPECT_TRUE(spec.scenes[0].goals.empty());
  EXPECT_TRUE(spec.scenes[1].episode_file.empty());
  EXPECT_THAT(error_of(with(kSpec, rules, rules + "    episode_file: set.jsonl\n")),
              AllOf(HasSubstr("goals"), HasSubstr("episode_file")));
}

TEST(Spec, ScenesAreTrainedOnRequest) {
  EXPECT_FALSE(parse(kSpec).find_scene("flat-1")->source->reconstruct.has_value());
  const auto trained = [](const std::string& fields) {
    return with(kSpec, "voxel_m: 0.03,", "voxel_m: 0.03, reconstruct: {" + fields + "},");
  };
  const specs::ExperimentSpec spec = parse(trained(
      "iterations: 500, label_iterations: 70, head: panoptic-lifting, seed: 9, config: "
      "\"${spec}/mine.yaml\""));
  const auto& reconstruct = spec.find_scene("flat-1")->source->reconstruct;
  ASSERT_TRUE(reconstruct.has_value());
  EXPECT_EQ(reconstruct->iterations, 500);
  EXPECT_EQ(reconstruct->label_iterations, 70);
  EXPECT_EQ(reconstruct->head, "panoptic-lifting");
  EXPECT_EQ(reconstruct->seed, 9U);
  EXPECT_EQ(reconstruct->config.filename(), "mine.yaml");
  EXPECT_TRUE(parse(trained("")).find_scene("flat-1")->source->reconstruct.has_value());
  EXPECT_THAT(error_of(trained("head: qery")), AllOf(HasSubstr(":8"), HasSubstr("query")));
  EXPECT_THAT(error_of(trained("iteration: 5")), HasSubstr("iterations"));
}

TEST(Spec, LeakageFollowsTheFineTuningScenes) {
  const specs::ExperimentSpec spec = parse(kSpec);
  const specs::ArmSpec& before = *spec.find_arm("before");
  const specs::ArmSpec& after = *spec.find_arm("after");
  EXPECT_TRUE(spec.leaks(after, *spec.find_scene("flat-1")));
  EXPECT_FALSE(spec.leaks(after, *spec.find_scene("office")));
  EXPECT_FALSE(spec.leaks(before, *spec.find_scene("flat-1")));
  // Without a list all scenes are tuned on.
  const specs::ExperimentSpec all = parse(with(kSpec, "scenes: [flat-1], ", ""));
  EXPECT_TRUE(all.leaks(*all.find_arm("after"), *all.find_scene("office")));
}

std::vector<std::string> names_of(const specs::ExperimentSpec& spec) {
  std::vector<std::string> names;
  for (const specs::ArmSpec& arm : spec.arms) names.push_back(arm.name);
  return names;
}

TEST(Spec, RepetitionsMayBeANumber) {
  for (const char* text : {"repetitions: 3\n", "repetitions: {trials: 3}\n"}) {
    const specs::ExperimentSpec spec = parse(std::string(kSpec) + text);
    EXPECT_EQ(spec.repetitions.trials, 3);
    EXPECT_EQ(spec.repetitions.finetune_seeds, 1);
    EXPECT_THAT(names_of(spec), ElementsAre("before", "after", "oracle", "other"));
    EXPECT_EQ(spec.scenes.size(), 2U);
  }
  EXPECT_EQ(parse(kSpec).repetitions.trials, 1);
  EXPECT_EQ(parse(std::string(kSpec) + "repetitions: {}\n").repetitions.trials, 1);
}

/// The first training keeps its name; every arm is of the family that the file names.
TEST(Spec, EveryTrainingIsAnArm) {
  const specs::ExperimentSpec spec =
      parse(std::string(kSpec) + "repetitions: {finetune_seeds: 3}\n");
  EXPECT_THAT(names_of(spec),
              ElementsAre("before", "after", "after.s3", "after.s4", "oracle", "other"));
  EXPECT_EQ(spec.scenes.size(), 2U);
  const specs::ArmSpec& third = *spec.find_arm("after.s4");
  EXPECT_EQ(third.family, "after");
  EXPECT_EQ(third.finetune_seed, std::optional<std::uint64_t>(4));
  EXPECT_EQ(third.score_threshold, std::optional<double>(0.4));
  EXPECT_TRUE(spec.leaks(third, *spec.find_scene("flat-1")));
  EXPECT_EQ(spec.find_arm("after")->finetune_seed, std::optional<std::uint64_t>(2));
  EXPECT_FALSE(spec.find_arm("before")->finetune_seed.has_value());
  // The first seed need not be 2.
  const specs::ExperimentSpec other =
      parse(with(std::string(kSpec), "views_per_scene: 30", "seed: 7, views_per_scene: 30") +
            "repetitions: {finetune_seeds: 2}\n");
  EXPECT_NE(other.find_arm("after.s8"), nullptr);
}

TEST(Spec, EveryReconstructionHasItsScenesAndArms) {
  std::string text = with(kSpec, "voxel_m: 0.03,", "voxel_m: 0.03, reconstruct: {seed: 5},");
  text = with(text, "frame_step: 2", "frame_step: 2, reconstruct: {}");
  const specs::ExperimentSpec spec =
      parse(text + "repetitions: {finetune_seeds: 2, reconstruct_seeds: 2}\n");
  EXPECT_THAT(names_of(spec),
              ElementsAre("before", "after", "after.s3", "oracle", "other", "before.r2",
                          "after.r2", "after.r2.s3", "oracle.r2", "other.r2"));
  ASSERT_EQ(spec.scenes.size(), 4U);
  EXPECT_EQ(spec.scenes[1].name, "office");
  const specs::SceneSpec& again = spec.scenes[2];
  EXPECT_EQ(again.name, "flat-1.r2");
  EXPECT_EQ(again.family, "flat-1");
  EXPECT_EQ(again.reconstruction, 2);
  EXPECT_EQ(again.title, "Flat 1, reconstruction 2");
  EXPECT_EQ(again.bundle, "out/two-flats/scenes/flat-1.r2");
  EXPECT_EQ(again.source->seed, 11U);              // The same recording, ...
  EXPECT_EQ(again.source->reconstruct->seed, 6U);  // ... another training.
  EXPECT_EQ(spec.scenes[0].source->reconstruct->seed, 5U);
  const specs::ArmSpec& arm = *spec.find_arm("after.r2.s3");
  EXPECT_EQ(arm.reconstruction, 2);
  EXPECT_EQ(arm.family, "after");
  EXPECT_TRUE(spec.leaks(arm, again));
  EXPECT_FALSE(spec.leaks(arm, *spec.find_scene("flat-1")));  // It never ran there.
}

TEST(Spec, RepetitionsThatCannotBeAreNamed) {
  const auto error = [](const std::string& fields) {
    return error_of(std::string(kSpec) + "repetitions: {" + fields + "}\n");
  };
  EXPECT_THAT(error("trials: 0"), AllOf(HasSubstr(":30"), HasSubstr("[1, 10000]")));
  EXPECT_THAT(error("finetune_seeds: 0"),
              AllOf(HasSubstr(":30"), HasSubstr("finetune_seeds"), HasSubstr("[1, 1000]")));
  EXPECT_THAT(error("finetune_seed: 2"), HasSubstr("finetune_seeds"));  // The nearest key.
  EXPECT_THAT(error("reconstruct_seeds: 2"),
              AllOf(HasSubstr(":30"), HasSubstr("reconstruct_seeds"),
                    HasSubstr("lifting draws nothing"), HasSubstr("flat-1")));
  EXPECT_THAT(error_of(std::string(kSpec) + "repetitions: 0\n"), HasSubstr("[1, 10000]"));
  EXPECT_THAT(error_of(std::string(kSpec) + "repetitions: [2]\n"), HasSubstr("repetitions"));
  const std::string tuned =
      "  finetune: {scenes: [flat-1], views_per_scene: 30, steps: 50, mix_share: 0.25, "
      "start_clearance_m: 0.5}\n";
  EXPECT_THAT(error_of(with(kSpec, tuned, "") + "repetitions: {finetune_seeds: 2}\n"),
              HasSubstr("detectors.finetune"));
  EXPECT_THAT(error_of(with(kSpec, "steps: 50,", "steps: 50, threads: 0,")),
              AllOf(HasSubstr(":18"), HasSubstr("threads")));
  EXPECT_EQ(parse(kSpec).detectors.finetune->threads, 1);
}

TEST(Spec, TheHashIsThatOfTheText) {
  EXPECT_EQ(parse(kSpec).sha256, parse(kSpec).sha256);
  EXPECT_NE(parse(kSpec).sha256, parse(with(kSpec, "seed: 7", "seed: 8")).sha256);
}

TEST(Spec, ABackendIsThatOfAllWorkButACamerasOfItsOwn) {
  EXPECT_EQ(parse(kSpec).backend, renderer::Backend::kCpu);
  const std::string asked = specs::with_backend(kSpec, renderer::Backend::kCuda);
  const specs::ExperimentSpec spec = parse(asked);
  EXPECT_EQ(spec.backend, renderer::Backend::kCuda);
  EXPECT_EQ(spec.camera.backend, renderer::Backend::kAuto);
  EXPECT_NE(spec.sha256, parse(kSpec).sha256);
  const specs::ExperimentSpec everywhere = parse(with(asked, ", backend: auto", ""));
  EXPECT_EQ(everywhere.camera.backend, renderer::Backend::kCuda);

  EXPECT_THAT(error_of(specs::with_backend(asked, renderer::Backend::kCpu)),
              AllOf(HasSubstr("backend"), HasSubstr("once")));
  EXPECT_THAT(error_of(std::string(kSpec) + "backend: auto\n"),
              AllOf(HasSubstr("cpu"), HasSubstr("cuda"), HasSubstr("auto")));
}

TEST(Spec, AnUnknownKeyIsNamedWithItsLineAndTheNearestKey) {
  EXPECT_THAT(
      error_of(with(kSpec, "planned_n: 6", "plannedn: 6")),
      AllOf(HasSubstr("specs/two.yaml:28"), HasSubstr("plannedn"), HasSubstr("planned_n")));
  EXPECT_THAT(error_of(with(kSpec, "    episodes: 6", "    epsiodes: 6")),
              AllOf(HasSubstr("specs/two.yaml:10"), HasSubstr("episodes")));
  EXPECT_THAT(error_of(with(kSpec, "backend: auto", "backend: gpu")),
              AllOf(HasSubstr(":26"), HasSubstr("cuda")));
  EXPECT_THAT(error_of(with(kSpec, "depth_range_m: 5", "depth_range: 5")),
              AllOf(HasSubstr(":26"), HasSubstr("depth_range_m")));
}

TEST(Spec, ARecordingsCamerasAndClocksAreRead) {
  const auto rig_of = [](const std::string& keys) {
    specs::SpecFolders folders{"/d", ""};
    return specs::parse_spec(with(kSpec, "frame_step: 2", keys + "frame_step: 2"),
                             "specs/two.yaml", folders)
        .scenes[1]
        .source->rig;
  };
  const specs::RigSpec plain = rig_of("");
  EXPECT_EQ(plain.text(), "");  // Recipes of bundles stay what they were.
  EXPECT_FALSE(plain.estimates());
  const specs::RigSpec stated = rig_of(
      "color_depth: \"${data}/rig.yaml\", depth_time_offset_ms: -12.5, "
      "pose_time_offset_ms: estimate, frame_rate_hz: 30, rolling_shutter_ms: 25, "
      "sensor: tof, ");
  EXPECT_EQ(stated.color_depth, "/d/rig.yaml");
  EXPECT_DOUBLE_EQ(*stated.depth_time.seconds(), -0.0125);
  EXPECT_TRUE(stated.pose_time.estimate && stated.estimates());
  EXPECT_DOUBLE_EQ(*stated.frame_rate_hz, 30.0);
  EXPECT_DOUBLE_EQ(*stated.read_out_ms, 25.0);
  EXPECT_EQ(stated.sensor, reconstruction::DepthSensor::kTof);
  const specs::RigSpec found = rig_of("color_depth: estimate, sensor: kinect-v1, ");
  EXPECT_TRUE(found.estimate_color_depth && found.color_depth.empty());
  EXPECT_EQ(found.text(), ", place of the depth camera estimated, sensor kinect-v1");
  const auto error_with = [](const std::string& keys) {
    return error_of(with(kSpec, "frame_step: 2", keys + "frame_step: 2"));
  };
  EXPECT_THAT(error_with("depth_time_offset_ms: soon, "),
              AllOf(HasSubstr("depth_time_offset_ms"), HasSubstr("soon")));
  EXPECT_THAT(error_with("sensor: lidar, "), AllOf(HasSubstr("sensor"), HasSubstr("stereo")));
  EXPECT_THAT(error_with("rolling_shutter_ms: 900, "), HasSubstr("[-200, 200]"));
}

TEST(Spec, AHomesPlanAndFurnitureAreRead) {
  const auto text_with = [](const std::string& keys) {
    return with(kSpec, "{type: flat, seed: 11,", "{type: home, seed: 11, " + keys);
  };
  const auto home_of = [&](const std::string& keys) {
    return parse(text_with(keys)).scenes[0].source;
  };
  const auto plain = home_of("");
  EXPECT_EQ(plain->type, specs::SourceType::kHome);
  EXPECT_EQ(plain->seed, 11U);
  EXPECT_EQ(plain->home.plan, worlds::HomePlan::kAny);
  EXPECT_EQ(plain->home.pool, worlds::FurniturePool::kTrain);
  const auto stated = home_of(
      "plan: office, rooms: 6, furniture: unseen, furniture_folder: \"${data}/sh3f\",");
  EXPECT_EQ(stated->home.plan, worlds::HomePlan::kOffice);
  EXPECT_EQ(specs::furniture_folder(stated->home), "/d/sh3f");
  EXPECT_EQ(specs::describe(stated->home), ", plan office, 6 rooms, furniture unseen");
  const auto own = home_of("furniture: own,");
  EXPECT_FALSE(specs::furniture_folder(own->home).has_value());
  EXPECT_EQ(specs::describe(own->home), ", plan any, furniture own");
  EXPECT_THAT(error_of(text_with("plan: castle,")),
              AllOf(HasSubstr("castle"), HasSubstr("ward")));
  EXPECT_THAT(error_of(text_with("rooms: 9,")), HasSubstr("rooms"));
  EXPECT_THAT(error_of(text_with("furniture: oak,")),
              AllOf(HasSubstr("furniture"), HasSubstr("unseen")));
}

TEST(Spec, AWrongTypeOrValueIsNamedWithItsLine) {
  EXPECT_THAT(error_of(with(kSpec, "episodes: 6", "episodes: six")),
              AllOf(HasSubstr(":10"), HasSubstr("integer"), HasSubstr("six")));
  EXPECT_THAT(error_of(with(kSpec, "hfov_deg: 80", "hfov_deg: 190")),
              AllOf(HasSubstr(":26"), HasSubstr("hfov_deg"), HasSubstr("[10, 150]"),
                    HasSubstr("190")));
  EXPECT_THAT(error_of(with(kSpec, "detector: after,", "detector: aftr,")),
              AllOf(HasSubstr(":21"), HasSubstr("near: after")));
  EXPECT_THAT(error_of(with(kSpec, "[flat-1], v", "[flat-2], v")), HasSubstr("near: flat-1"));
  EXPECT_THAT(error_of(with(kSpec, "robot: jackal-gentle", "robot: jakal")),
              AllOf(HasSubstr(":24"), HasSubstr("jackal")));
  EXPECT_THAT(
      error_of(with(kSpec, "robot: jackal-gentle", "collision: navmsh\nrobot: jackal-gentle")),
      AllOf(HasSubstr(":24"), HasSubstr("near: navmesh")));
  EXPECT_THAT(error_of(with(kSpec, "name: after", "name: before")), HasSubstr("a new name"));
  EXPECT_THAT(error_of(with(kSpec, "name: flat-1", "name: flat/1")), HasSubstr("letters"));
  EXPECT_THAT(error_of(with(kSpec, "control_period_s: 0.2", "control_period_s: 0.033")),
              HasSubstr("0.005"));
  EXPECT_THAT(error_of(with(kSpec, "segsim.experiment/1", "segsim.experiment/2")),
              HasSubstr("segsim.experiment/1"));
}

TEST(Spec, AnArmMayHaveAPolicyOfItsOwn) {
  const specs::ExperimentSpec spec =
      parse(with(kSpec, "{name: oracle, detector: oracle}",
                 "{name: oracle, detector: oracle, policy: {type: vlfm, parity: vlfm}}"));
  EXPECT_EQ(spec.policy.name(), "frontier");
  EXPECT_FALSE(spec.find_arm("before")->policy);
  ASSERT_TRUE(spec.find_arm("oracle")->policy);
  EXPECT_EQ(spec.find_arm("oracle")->policy->name(), "vlfm");
  const auto* settings = spec.find_arm("oracle")->policy->settings<nav::VlfmSettings>();
  ASSERT_NE(settings, nullptr);
  EXPECT_EQ(settings->rules.text(), "vlfm");
  EXPECT_EQ(parse(with(kSpec, "robot:", "policy: frontier-value\nrobot:")).policy.name(),
            "frontier-value");
  EXPECT_THAT(error_of(with(kSpec, "robot:", "policy: vlmf\nrobot:")),
              AllOf(HasSubstr("specs/two.yaml:"), HasSubstr("near: vlfm")));
}

TEST(Spec, ASceneTakesTheRobotsCameraHeight) {
  const specs::ExperimentSpec jackal = parse(kSpec);
  EXPECT_EQ(jackal.scenes[0].camera_height_m, 1.1);  // Its own.
  EXPECT_EQ(jackal.scenes[1].camera_height_m, 1.2);
  const specs::ExperimentSpec turtle =
      parse(with(kSpec, "robot: jackal-gentle", "robot: turtlebot3-waffle"));
  EXPECT_EQ(turtle.scenes[0].camera_height_m, 1.1);
  EXPECT_EQ(turtle.scenes[1].camera_height_m, 0.55);
}

/// What is made for a robot from a file is made again when the file changes.
TEST(Spec, ARobotFromAFileIsPartOfTheSpec) {
  const std::filesystem::path folder = testing::TempDir();
  const auto spec_of = [&](double width_m) {
    core::write_file_atomically(folder / "mine.yaml", [&](std::ostream& out) {
      out << "{schema: segsim.robot/1, name: mine, body_top_m: 0.3, clearance_m: 0.02,\n"
             " base: {length_m: 0.4, height_m: 0.2, width_m: "
          << width_m
          << "}, camera_height_m: 0.5,\n limits: {forward_mps: 0.5, turn_radps: 1, "
             "acceleration_mps2: 1,\n deceleration_mps2: 1, turn_acceleration_radps2: 2},\n"
             " wheels: {radius_m: 0.05, track_m: 0.2, max_mps: 0.6}}\n";
    });
    return parse(with(kSpec, "robot: jackal-gentle", "robot: \"${data}/mine.yaml\""),
                 {folder, ""});
  };
  const specs::ExperimentSpec narrow = spec_of(0.3), wide = spec_of(0.4), again = spec_of(0.3);
  EXPECT_EQ(narrow.robot.width_m, 0.3);
  EXPECT_THAT(narrow.robot.name, testing::StartsWith("mine@"));
  EXPECT_NE(narrow.robot.name, wide.robot.name);
  EXPECT_NE(narrow.sha256, wide.sha256);
  EXPECT_EQ(narrow.sha256, again.sha256);
  EXPECT_THAT(error_of(with(kSpec, "robot: jackal-gentle", "robot: \"${data}/none.yaml\"")),
              HasSubstr("none.yaml"));
}

TEST(Spec, VariablesInPathsAreChecked) {
  EXPECT_THAT(error_of(kSpec, {"", ""}), AllOf(HasSubstr(":13"), HasSubstr("--data")));
  EXPECT_THAT(error_of(with(kSpec, "${data}/office", "${date}/office")),
              AllOf(HasSubstr(":13"), HasSubstr("${date}")));
  EXPECT_THAT(error_of(with(kSpec, "${data}/office", "${data/office")), HasSubstr("closing"));
}

TEST(Spec, MissingPartsAreNamed) {
  EXPECT_THAT(error_of("schema: segsim.experiment/1\nname: x\n"), HasSubstr("scenes"));
  EXPECT_THAT(error_of("name: x\n"), HasSubstr("schema"));
  EXPECT_THAT(error_of("schema: segsim.experiment/1\nname: x\nscenes: []\narms: []\n"),
              HasSubstr("at least one scene"));
}

TEST(Spec, TheSpecsOfTheRepositoryAreValid) {
  const std::filesystem::path folder = SEGSIM_SPECS;
  int found = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".yaml") continue;
    specs::SpecFolders folders{"/data", ""};
    const specs::ExperimentSpec spec = specs::load_spec(entry.path(), folders);
    std::string name = entry.path().lexically_relative(folder).replace_extension().string();
    std::replace(name.begin(), name.end(), '/', '_');
    EXPECT_EQ(spec.name, name);
    // Without it a table cannot tell the detector's failures from navigation's.
    EXPECT_TRUE(std::any_of(spec.arms.begin(), spec.arms.end(), [](const specs::ArmSpec& arm) {
      return arm.detector == specs::ArmDetector::kOracle;
    })) << spec.name;
    ++found;
  }
  EXPECT_GE(found, 3);
}

}  // namespace
}  // namespace segsim::experiments
