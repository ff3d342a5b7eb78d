// Several trainings and several reconstructions, through the whole of a run.
#include <algorithm>
#include <fstream>
#include <map>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "core/scene_bundle.h"
#include "experiments/detection/view_labels.h"
#include "experiments/episodes/episodes.h"
#include "experiments/records/results_digest.h"
#include "experiments/results/stored_run.h"
#include "experiments/runs/merge_runs.h"
#include "experiments/runs/run.h"
#include "experiments/runs/trial_replay.h"
#include "experiments/trials/trial_runner.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/data/dataset.h"
#include "perception/training/training.h"
#include "sim/ground/robot.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::UnorderedElementsAre;

/// A detector of these classes that has seen next to nothing: folder/`name`.bin.
void write_before_weights(const fs::path& folder, const std::string& name,
                          const std::vector<std::string>& class_names) {
  detection::ViewLabelOptions views;
  views.views = 4;
  views.camera = core::CameraIntrinsics::from_fov(64, 48, 1.2);
  views.camera_height_m = 1.0;
  views.class_names = class_names;
  views.show_progress = false;
  const perception::CocoDataset dataset =
      detection::label_views(core::load_bundle(folder / "tiny"),
                             sim::RobotModel::by_name("jackal-gentle"), views, folder)
          .dataset;
  perception::write_coco(folder / (name + ".json"), dataset);
  perception::TrainOptions train;
  train.train_json = folder / (name + ".json");
  train.output = folder / (name + ".bin");
  train.width = 0.25;
  train.input_px = 64;
  train.steps = 2;
  train.batch = 2;
  train.show_progress = false;
  (void)perception::train(train);
}

std::string spec_text(const std::string& repetitions) {
  return TinySpec{.goals = "couch, chair",
                  .episodes = 2,
                  .arms =
                      "  - {name: before, detector: before}\n"
                      "  - {name: after, detector: after}\n"
                      "  - {name: oracle, detector: oracle}\n",
                  .time_limit_s = 4.0,
                  .more =
                      "detectors:\n"
                      "  before: ${data}/before.bin\n"
                      "  finetune: {views_per_scene: 6, steps: 3, width: 64, height: 48}\n"
                      "pictures: false\n"
                      "frames: {of: first, every_s: 2}\n"
                      "repetitions: " +
                      repetitions + "\n"}
      .text();
}

class Repetitions : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("repetitions");
    TinyScene().write(folder_->path() / "tiny");
    write_before_weights(folder_->path(), "before", {"chair", "couch"});
    write_before_weights(folder_->path(), "chairs", {"chair"});
  }
  static void TearDownTestSuite() { delete folder_; }

  static fs::path work(const std::string& name) { return folder_->path() / name; }

  static specs::ExperimentSpec spec_of(const std::string& text, const std::string& name,
                                       runs::RunOptions& options) {
    options.folders = {folder_->path(), work(name)};
    return specs::parse_spec(text, "tiny.yaml", options.folders);
  }

  static runs::RunReport run(const std::string& text, const std::string& name, int workers,
                             std::optional<runs::Shard> shard = {}) {
    runs::RunOptions options;
    options.workers = workers;
    options.shard = shard;
    const specs::ExperimentSpec spec = spec_of(text, name, options);
    return runs::run_experiment(spec, options);
  }

  static TemporaryFolder* folder_;
};
TemporaryFolder* Repetitions::folder_ = nullptr;

std::vector<std::string> essences(const fs::path& work, const std::string& arm) {
  std::vector<std::string> lines;
  for (const records::TrialRow& trial : results::load_run(work).trials) {
    if (trial.arm == arm) lines.push_back(records::essence_of(trial));
  }
  return lines;
}

std::set<std::string> names_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    names.insert(entry.path().filename().string());
  }
  return names;
}

TEST_F(Repetitions, EveryTrainingHasItsViewsWeightsAndTrials) {
  const runs::RunReport report = run(spec_text("{finetune_seeds: 2}"), "two", 1);
  EXPECT_EQ(report.trials_run, 2 * 4);
  EXPECT_EQ(report.trials_failed, 0);
  const fs::path folder = work("two");
  for (const char* file : {"detector-after.bin", "detector-after.s3.bin", "arm-before.weights",
                           "arm-after.weights", "arm-after.s3.weights", "views/train.json",
                           "views/validation.json", "views/test.json", "views.s3/train.json",
                           "logs/tiny/couch-00.after.s3.json.gz"}) {
    EXPECT_TRUE(fs::exists(folder / file)) << file;
  }
  // What is recorded of an arm is recorded once.
  EXPECT_THAT(names_in(folder / "frames/tiny"),
              ElementsAre("couch-00.after", "couch-00.before", "couch-00.oracle"));
  // Where trials end there may be views that these trainings had; others had none.
  for (const records::TrialRow& trial : results::load_run(folder).trials) {
    EXPECT_EQ(trial.why.stop_views >= 0, trial.arm.starts_with("after")) << trial.arm;
  }
  // Views that judge are those of the reconstruction, whoever is trained.
  EXPECT_FALSE(fs::exists(folder / "views.s3/validation.json"));
  EXPECT_NE(core::read_file(folder / "views/train.json"),
            core::read_file(folder / "views.s3/train.json"));

  const results::StoredRun stored = results::load_run(folder);
  ASSERT_EQ(stored.arms.size(), 4U);
  const records::ArmRow &first = stored.arms[1], &second = stored.arms[2];
  EXPECT_EQ(first.name, "after");
  EXPECT_EQ(second.name, "after.s3");
  EXPECT_EQ(second.family, "after");
  EXPECT_EQ(first.finetune_seed, std::optional<std::uint64_t>(2));
  EXPECT_EQ(second.finetune_seed, std::optional<std::uint64_t>(3));
  EXPECT_NE(first.weights_sha256, second.weights_sha256);
  EXPECT_EQ(second.weights_sha256, core::sha256_of_file(folder / "arm-after.s3.weights"));
  EXPECT_EQ(second.tuned_on, "tiny");
  for (const records::ArmRow& arm : {first, second}) {
    ASSERT_TRUE(arm.start_leak && arm.held_out);
    EXPECT_EQ(arm.start_leak->views, 6);
    EXPECT_EQ(arm.held_out->views, 10);
  }
  EXPECT_FALSE(stored.arms[0].start_leak.has_value());
  EXPECT_EQ(report.table.trainings.size(), 2U);
  EXPECT_TRUE(report.table.compares_trainings);
  EXPECT_EQ(report.table.scenes[0].find("after")->success.trials, 4);
  EXPECT_EQ(report.table.scenes[0].pairs.total(), 4);

  // Times of the stages are told and kept.
  std::vector<std::string> stages;
  for (const support::StageTime& time : report.times) stages.push_back(time.stage);
  EXPECT_THAT(stages, ElementsAre("episodes", "label views", "fine-tuning", "thresholds",
                                  "trials", "tables"));
  EXPECT_THAT(stored.run.provenance.at("time/fine-tuning"), HasSubstr(" s"));

  // A second call finds everything.
  const runs::RunReport again = run(spec_text("{finetune_seeds: 2}"), "two", 1);
  EXPECT_EQ(again.trials_run, 0);
  EXPECT_EQ(again.times.size(), report.times.size() - 1) << "all but the trials";
  for (const support::StageTime& time : again.times)
    EXPECT_EQ(time.made, time.stage == "tables");
  EXPECT_EQ(results::load_run(folder).run.provenance.at("time/fine-tuning"),
            stored.run.provenance.at("time/fine-tuning"));
}

/// The spec with weights that know chairs alone, and couches among the goals.
std::string chairs_spec() {
  std::string text = spec_text("{finetune_seeds: 1}");
  const std::string file = "before.bin";
  return text.replace(text.find(file), file.size(), "chairs.bin");
}

TEST_F(Repetitions, AGoalThatBeforeDoesNotKnowGetsAHeadAndANote) {
  const runs::RunReport report = run(chairs_spec(), "chairs", 1);
  EXPECT_EQ(report.trials_failed, 0);
  const auto classes_of = [](const char* file) {
    return perception::read_weights(work("chairs") / file).class_names;
  };
  EXPECT_THAT(classes_of("arm-before.weights"), ElementsAre("chair"));
  EXPECT_THAT(classes_of("arm-after.weights"), ElementsAre("chair", "couch"));
  const perception::CocoDataset views =
      perception::read_coco(work("chairs") / "views/train.json");
  EXPECT_THAT(views.class_names, ElementsAre("chair", "couch"));
  EXPECT_THAT(report.table.notes,
              testing::Contains(HasSubstr("New classes: \"before\" does not know couch,")));
  // What was made is found again.
  const runs::RunReport again = run(chairs_spec(), "chairs", 1);
  for (const support::StageTime& time : again.times)
    EXPECT_EQ(time.made, time.stage == "tables") << time.stage;
}

TEST_F(Repetitions, AGoalThatNoDetectorKnowsIsRefusedBeforeAnyTrial) {
  std::string text = chairs_spec();
  const std::size_t finetune = text.find("  finetune:");
  text.erase(finetune, text.find('\n', finetune) + 1 - finetune);
  const std::string after = "  - {name: after, detector: after}\n";
  text.erase(text.find(after), after.size());
  const std::string repeat = "repetitions: {finetune_seeds: 1}\n";
  text.erase(text.find(repeat), repeat.size());
  EXPECT_EQ(tests::input_error_of([&] { (void)run(text, "none", 1); }),
            "scene tiny, arm before: expected goals that its detector knows (chair), or "
            "fine-tuning in that scene, which teaches new ones, found couch");
  EXPECT_FALSE(fs::exists(work("none") / "results.sqlite"));
}

/// Side by side, or in parts: the same bits. One seed: those of the first training.
TEST_F(Repetitions, NothingDependsOnWhatRunsBesideIt) {
  const std::string text = spec_text("{finetune_seeds: 2}");
  const runs::RunReport whole = run(text, "two", 1);  // Perhaps there already.
  EXPECT_EQ(run(text, "beside", 4).results_sha256, whole.results_sha256);
  for (const char* file : {"detector-after.bin", "detector-after.s3.bin", "arm-before.weights",
                           "arm-after.weights", "arm-after.s3.weights", "views/train.json",
                           "views/test.json", "views.s3/train.json"}) {
    EXPECT_EQ(core::sha256_of_file(work("two") / file),
              core::sha256_of_file(work("beside") / file))
        << file;
  }

  for (int part = 0; part < 2; ++part) (void)run(text, "parts", 2, runs::Shard{part, 2});
  const std::vector<fs::path> shards = runs::shard_folders(work("parts"));
  ASSERT_EQ(shards.size(), 2U);
  for (const fs::path& shard : shards) {  // Whole units: an episode with all its arms.
    std::map<std::string, int> arms;
    for (const records::TrialRow& trial : results::load_run(shard).trials)
      ++arms[trial.episode];
    for (const auto& [episode, count] : arms) EXPECT_EQ(count, 4) << episode;
  }
  EXPECT_EQ(runs::merge_runs(work("parts"), shards).results_sha256, whole.results_sha256);
  for (const auto& [name, value] : results::load_run(work("parts")).run.provenance) {
    EXPECT_FALSE(name.starts_with("time/")) << name;
  }

  (void)run(spec_text("1"), "one", 1);
  for (const char* file : {"detector-after.bin", "arm-before.weights", "arm-after.weights"}) {
    EXPECT_EQ(core::sha256_of_file(work("two") / file),
              core::sha256_of_file(work("one") / file))
        << file;
  }
  for (const char* arm : {"before", "after", "oracle"}) {
    EXPECT_EQ(essences(work("one"), arm), essences(work("two"), arm)) << arm;
  }
  EXPECT_TRUE(essences(work("one"), "after.s3").empty());
}

/// Killed after the first training: what is there stays, the rest is made.
TEST_F(Repetitions, AKilledPreparationGoesOnWithTheNextTraining) {
  const std::string text = spec_text("{finetune_seeds: 2}");
  const std::string whole = run(text, "two", 1).results_sha256;
  runs::RunOptions options;
  const specs::ExperimentSpec spec = spec_of(text, "killed", options);
  options.prepare_only = true;
  (void)runs::run_experiment(spec, options);
  for (const char* file : {"detector-after.s3.bin", "detector-after.s3.step",
                           "arm-after.s3.weights", "arm-after.s3.weights.precision.json"}) {
    EXPECT_TRUE(fs::remove(work("killed") / file)) << file;
  }
  fs::remove(work("killed") / "results.sqlite");
  const auto written = fs::last_write_time(work("killed") / "detector-after.bin");
  EXPECT_EQ(run(text, "killed", 2).results_sha256, whole);
  EXPECT_EQ(fs::last_write_time(work("killed") / "detector-after.bin"), written);
}

TEST_F(Repetitions, ATrialOfALaterTrainingIsPlayedAgain) {
  (void)run(spec_text("{finetune_seeds: 2}"), "two", 1);
  const fs::path file = work("two") / "replays/tiny/couch-00.after.s3.jsonl";
  const records::ReplayLog log = records::read_replay_log(file);
  runs::TrialReplay replay(log, {folder_->path(), work("two")}, false);  // Detects anew.
  EXPECT_EQ(replay.play(log, file).state_hash, log.state_hash);
}

/// The two rooms as two reconstructions of one scene, made by hand.
specs::ExperimentSpec two_reconstructions(specs::ExperimentSpec spec, const fs::path& folder) {
  fs::copy(folder / "tiny", folder / "tiny.r2",
           fs::copy_options::recursive | fs::copy_options::skip_existing);
  core::SceneBundle bundle = core::load_bundle(folder / "tiny.r2");
  if (bundle.manifest.name == "tiny") {
    bundle.manifest.name = "tiny.r2";
    core::write_bundle_manifest(folder / "tiny.r2", bundle.manifest);
  }
  spec.repetitions.reconstruct_seeds = 2;
  spec.scenes.push_back(spec.scenes[0]);
  spec.scenes[1].name = "tiny.r2";
  spec.scenes[1].reconstruction = 2;
  spec.scenes[1].bundle = folder / "tiny.r2";
  const std::vector<specs::ArmSpec> arms = spec.arms;
  for (specs::ArmSpec arm : arms) {
    arm.reconstruction = 2;
    arm.name = arm.family + specs::repetition_suffix(spec, 2, arm.finetune_seed);
    spec.arms.push_back(std::move(arm));
  }
  return spec;
}

TEST_F(Repetitions, ReconstructionsShareEpisodesAndPair) {
  runs::RunOptions options;
  options.workers = 2;
  const specs::ExperimentSpec spec = two_reconstructions(
      spec_of(spec_text("{finetune_seeds: 2}"), "rooms", options), folder_->path());
  const runs::RunReport report = runs::run_experiment(spec, options);
  EXPECT_EQ(report.trials_run, 2 * 2 * 4);
  EXPECT_EQ(report.trials_failed, 0);

  const episodes::EpisodeSet first =
      episodes::read_episodes(work("rooms") / "episodes/tiny.jsonl");
  const episodes::EpisodeSet second =
      episodes::read_episodes(work("rooms") / "episodes/tiny.r2.jsonl");
  EXPECT_NE(first.scene_sha256, second.scene_sha256);
  ASSERT_EQ(first.episodes.size(), second.episodes.size());
  for (std::size_t k = 0; k < first.episodes.size(); ++k) {
    const sim::Episode &a = first.episodes[k], &b = second.episodes[k];
    EXPECT_EQ(a.id, b.id);
    EXPECT_EQ(a.seed, b.seed);
    EXPECT_EQ(a.start.x_m, b.start.x_m);
    EXPECT_EQ(a.start.yaw_rad, b.start.yaw_rad);
    EXPECT_EQ(a.view_points_m, b.view_points_m);
    EXPECT_NEAR(a.shortest_path_m, b.shortest_path_m, 1e-9);  // The same rooms.
    EXPECT_TRUE(b.view_point_instance.empty());
  }

  // An arm runs in the scenes of its reconstruction only.
  const results::StoredRun stored = results::load_run(work("rooms"));
  std::map<std::string, std::set<std::string>> scenes;
  for (const records::TrialRow& trial : stored.trials) scenes[trial.arm].insert(trial.scene);
  EXPECT_EQ(scenes.size(), 8U);
  for (const records::ArmRow& arm : stored.arms) {
    EXPECT_THAT(scenes[arm.name], ElementsAre(arm.reconstruction == 1 ? "tiny" : "tiny.r2"));
    if (arm.family == "oracle") continue;
    // Both scenes have the surfels that 'before' has learnt from, but an arm tells of its own.
    const std::string own = arm.reconstruction == 1 ? "tiny" : "tiny.r2";
    EXPECT_EQ(arm.tuned_on, own);
    EXPECT_EQ(records::exposure_text(arm.exposure.value()),
              "trained on " + own + "; threshold chosen on " + own);
  }
  // Both reconstructions have the episodes of the first, so one folder has the frames of all.
  EXPECT_THAT(names_in(work("rooms") / "frames/tiny"),
              ElementsAre("couch-00.after", "couch-00.after.r2", "couch-00.before",
                          "couch-00.before.r2", "couch-00.oracle", "couch-00.oracle.r2"));
  // The oracle sees the same rooms: whatever comes out is the same.
  EXPECT_TRUE(fs::exists(work("rooms") / "views.r2.s3/train.json"));
  EXPECT_TRUE(fs::exists(work("rooms") / "views.r2/test.json"));
  EXPECT_NE(core::read_file(work("rooms") / "views.r2/test.json"),
            core::read_file(work("rooms") / "views/test.json"));

  const results::ResultTable& table = report.table;
  ASSERT_EQ(table.scenes.size(), 1U);
  EXPECT_TRUE(table.scenes[0].leak);
  ASSERT_EQ(table.trainings.size(), 4U);
  EXPECT_EQ(table.trainings[3].arm, "after.r2.s3");
  EXPECT_EQ(table.trainings[3].before, "before.r2");
  EXPECT_EQ(table.scenes[0].find("before")->success.trials, 4);
  EXPECT_EQ(table.scenes[0].find("after")->success.trials, 8);
  EXPECT_EQ(table.scenes[0].pairs.total(), 8);
  EXPECT_THAT(results::format_table(table, support::TableFormat::kText),
              HasSubstr("4 trainings in 2 reconstructions"));
}

/// What the second reconstruction has no room for is in no rate there.
TEST_F(Repetitions, EpisodesThatDoNotFitASecondReconstructionAreInNoRate) {
  runs::RunOptions options;
  const specs::ExperimentSpec spec =
      two_reconstructions(spec_of(spec_text("1"), "shifted", options), folder_->path());
  (void)trials::load_scene(spec, spec.scenes[0], folder_->path() / "tiny", work("shifted"));
  const fs::path file = work("shifted") / "episodes/tiny.jsonl";
  episodes::EpisodeSet set = episodes::read_episodes(file);
  set.episodes[0].start = {40.0, 0.0, 0.0};
  episodes::write_episodes(file, set);
  const trials::LoadedScene second =
      trials::load_scene(spec, spec.scenes[1], folder_->path() / "tiny.r2", work("shifted"));
  EXPECT_FALSE(std::isfinite(second.episodes.episodes[0].shortest_path_m));
  EXPECT_TRUE(std::isfinite(second.episodes.episodes[1].shortest_path_m));
  fs::remove(file);  // Without the first there are none.
  EXPECT_THROW((void)trials::load_scene(spec, spec.scenes[1], folder_->path() / "tiny.r2",
                                        work("shifted")),
               core::InputError);
}

}  // namespace
}  // namespace segsim::experiments
