// Fine-tuning on labels that are learnt from masks, as a spec asks for with source.masks.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/bundle_parts.h"
#include "core/error.h"
#include "core/file_io.h"
#include "experiments/runs/run.h"
#include "experiments/scenes/scene_surfels.h"
#include "perception/data/dataset.h"
#include "perception/training/training.h"
#include "reconstruction/datasets/mask_files.h"
#include "tests/experiments/start_weights.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;
using tests::TemporaryFolder;

/// A small flat, trained for a moment.
std::string spec_text(const std::string& masks) {
  return R"(schema: segsim.experiment/1
name: masked
seed: 7
scenes:
  - name: flat
    source:
      type: flat
      seed: 6
      voxel_m: 0.06
      capture: {frames: 40, width: 128, height: 96, hfov_deg: 90}
      reconstruct: {iterations: 5, label_iterations: 60, seed: 1}
)" + masks +
         R"(    goals: [chair, couch]
    episodes: 1
detectors:
  before: ${data}/start.weights
  finetune: {views_per_scene: 6, validation_views_per_scene: 4, steps: 1, measure_elsewhere: false}
arms:
  - {name: before, detector: before}
  - {name: after, detector: after}
  - {name: after-exact, detector: after-exact}
camera: {width: 96, height: 72, hfov_deg: 79}
)";
}

class RunMasksTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("run_masks");
    write_start_weights(folder_->path());
  }
  static void TearDownTestSuite() { delete folder_; }

  static specs::SpecFolders folders(const std::string& work) {
    return {folder_->path(), *folder_ / work};
  }
  /// Everything but the trials.
  static runs::RunReport prepare(const std::string& masks, bool anew = false) {
    runs::RunOptions options;
    options.folders = folders("work");
    options.new_run = anew;
    options.prepare_only = true;
    return runs::run_experiment(
        specs::parse_spec(spec_text(masks), "masked.yaml", options.folders), options);
  }

  static TemporaryFolder* folder_;
};
TemporaryFolder* RunMasksTest::folder_ = nullptr;

TEST_F(RunMasksTest, LabelsAreLearntFromMasksOfTheSamePlace) {
  const std::string simulated = "      masks: {simulate: {level: 1, seed: 3}}\n";
  const runs::RunReport report = prepare(simulated);
  EXPECT_THAT(
      report.table.notes,
      Contains(AllOf(HasSubstr("Labels of flat for \"after\" were learnt from masks: "
                               "simulated, level 1, seed 3"),
                     HasSubstr("PQ of single views"), HasSubstr("PQ of the learnt scene"))));
  const fs::path work = *folder_ / "work";
  const core::SceneBundle truth = core::load_bundle(work / "scenes" / "flat");
  const core::SceneBundle learnt = core::load_bundle(work / "labels" / "flat-from-masks");
  EXPECT_THAT(learnt.manifest.source, HasSubstr("labels learnt from masks: simulated"));
  EXPECT_THAT(truth.manifest.source, Not(HasSubstr("masks")));

  // The same surfels, with labels of their own.
  const scenes::SceneSurfels true_scene = scenes::load_scene_surfels(truth);
  const scenes::SceneSurfels learnt_scene = scenes::load_scene_surfels(learnt);
  EXPECT_EQ(learnt_scene.surfels->position_m, true_scene.surfels->position_m);
  EXPECT_EQ(learnt_scene.surfels->opacity, true_scene.surfels->opacity);
  EXPECT_NE(learnt_scene.surfels->semantic_id, true_scene.surfels->semantic_id);
  EXPECT_EQ(core::sha256_of_file(learnt.navmesh_file()),
            core::sha256_of_file(truth.navmesh_file()));
  EXPECT_EQ(core::load_bundle_parts(learnt.folder).levelling.p_world_source_m,
            core::load_bundle_parts(truth.folder).levelling.p_world_source_m);

  // Views of the place, whichever of its labels they have.
  const perception::CocoDataset train = perception::read_coco(work / "views" / "train.json");
  ASSERT_TRUE(train.scenes.has_value());
  ASSERT_EQ(train.scenes->size(), 1U);
  EXPECT_EQ((*train.scenes)[0].surfels_sha256, truth.manifest.surfels.sha256);

  // What the masks cost: the same views, as the recording's labels have them.
  const perception::CocoDataset exact =
      perception::read_coco(work / "views.exact" / "train.json");
  ASSERT_EQ(exact.scenes, train.scenes);
  EXPECT_TRUE(fs::exists(work / "views.exact" / "validation.json"));
  EXPECT_FALSE(fs::exists(work / "views.exact" / "test.json"));
  const auto boxes_of = [](const perception::CocoDataset& set) {
    std::vector<std::size_t> boxes;
    for (const auto& image : set.images) boxes.push_back(image.boxes.size());
    return boxes;
  };
  EXPECT_NE(boxes_of(exact), boxes_of(train));

  // A second call finds all of it.
  for (const support::StageTime& stage : prepare(simulated).times) {
    EXPECT_FALSE(stage.made && stage.stage.starts_with("labels")) << stage.stage;
  }

  // Masks that are given are other labels, and other views to learn from; the place stays.
  fs::path made;
  for (const auto& entry : fs::directory_iterator(work / "masks")) made = entry.path();
  fs::rename(made, *folder_ / "given");
  const std::string views_before = core::sha256_of_file(work / "views" / "train.step");
  EXPECT_THAT(prepare("      masks: {folder: \"${data}/given\"}\n", true).table.notes,
              Contains(HasSubstr("simulated, level 1, seed 3")));
  EXPECT_TRUE(fs::is_empty(work / "masks"));
  EXPECT_NE(core::sha256_of_file(work / "views" / "train.step"), views_before);
  EXPECT_EQ(core::load_bundle(work / "scenes" / "flat").scene_sha256, truth.scene_sha256);
}

TEST_F(RunMasksTest, BadMasksAreNamed) {
  const auto message = [](const std::string& masks, const std::string& reconstruct) {
    std::string text = spec_text(masks);
    const std::string line =
        "      reconstruct: {iterations: 5, label_iterations: 60, seed: 1}\n";
    text.replace(text.find(line), line.size(), reconstruct);
    specs::SpecFolders where = folders("bad");
    try {
      (void)specs::parse_spec(text, "masked.yaml", where);
    } catch (const core::InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  const std::string trained = "      reconstruct: {label_iterations: 60}\n";
  EXPECT_THAT(
      message("      masks: {simulate: {}, folder: a}\n", trained),
      AllOf(HasSubstr("one of the keys simulate, folder and detect"), HasSubstr("found 2")));
  EXPECT_THAT(message("      masks: {simulate: {levle: 1}}\n", trained), HasSubstr("levle"));
  EXPECT_THAT(message("      masks: {simulate: {}}\n", ""), HasSubstr("source.reconstruct"));
  EXPECT_THAT(message("", trained), HasSubstr("without which after-exact is as after"));
  EXPECT_THAT(message("      masks: {simulate: {}}\n", "      reconstruct: {head: none}\n"),
              HasSubstr("head none"));
  for (const char* masks : {"{folder: \"${data}/nowhere\"}",
                            "{detect: {detector: \"${data}/nowhere.weights\"}}"}) {
    try {
      (void)prepare(std::string("      masks: ") + masks + "\n", true);
      FAIL() << "no error";
    } catch (const core::InputError& error) {
      EXPECT_THAT(error.what(), AllOf(HasSubstr("nowhere"), HasSubstr("found none")));
    }
  }
}

}  // namespace
}  // namespace segsim::experiments
