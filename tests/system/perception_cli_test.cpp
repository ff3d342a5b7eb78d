// Labels, detectors and masks by the executable, on a small room.

#include <array>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "core/frame_masks.h"
#include "reconstruction/datasets/mask_files.h"
#include "segsim_process.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"
#include "tests/perception/clip_model.h"
#include "tests/perception/depth_model.h"
#include "tests/perception/tiny_models.h"

namespace segsim {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using tests::expect_input_error;
using tests::ProcessOutput;
using tests::run_segsim;

/// A copy whose record of what it was trained on has a purpose of the same length that is
/// none.
void damage_record(const std::string& weights, const std::string& copy) {
  std::string bytes = core::read_file(weights);
  const std::string purpose = R"("what":"train")";
  bytes.replace(bytes.find(purpose), purpose.size(), R"("what":"brain")");
  std::ofstream(copy, std::ios::binary) << bytes;
}

class PerceptionCli : public ::testing::Test {
 protected:
  PerceptionCli() : folder_("perception_cli") {}
  [[nodiscard]] std::string at(const std::string& name) const {
    return (folder_.path() / name).string();
  }
  static void expect_success(const ProcessOutput& run) {
    EXPECT_EQ(run.exit_code, 0) << run.text;
  }

  experiments::TemporaryFolder folder_;
};

TEST_F(PerceptionCli, LabelsTrainTunesAndCompares) {
  (void)experiments::TinyScene().write(at("tiny"));
  expect_success(
      run_segsim("label " + at("tiny") + " --out " + at("views") +
                 " --views 16 --val-share 0.4 --width 96 --height 72 --classes couch "
                 "chair --robot jackal-gentle"));
  for (const char* file : {"labels.json", "train.json", "val_views.json", "report.md",
                           "consistency.csv", "contact_sheet.png", "data.yaml"}) {
    EXPECT_TRUE(fs::exists(at("views") + "/" + file)) << file;
  }
  const std::string options = " --threads 1 --train " + at("views/train.json");
  expect_success(
      run_segsim("detector train --model small --width 0.25 --input-px 64 --steps 3 "
                 "--batch 2 --out " +
                 at("before.weights") + options));
  expect_success(run_segsim("detector finetune --steps 2 --batch 2 --from " +
                            at("before.weights") + " --out " + at("after.weights") + options));
  const std::string compare = "detector compare --before " + at("before.weights") +
                              " --after " + at("after.weights") + " --rounds 20 --out " +
                              at("report") + " --record " + at("record.json");
  const ProcessOutput run = run_segsim(compare + " --on views=" + at("views/val_views.json"));
  expect_success(run);
  EXPECT_THAT(run.text, HasSubstr("Not checked: whether 'after' was trained on views near"));
  EXPECT_THAT(run.text, HasSubstr("views: after.weights was trained on views of scenes that "
                                  "the images show: tiny"));
  for (const char* file : {"compare.txt", "compare.md", "compare.csv", "compare.json",
                           "precision-views.png", "confusion-views.png", "misses-views.png"}) {
    EXPECT_TRUE(fs::exists(at("report") + "/" + file)) << file;
  }
  EXPECT_THAT(core::read_file(at("record.json")),
              HasSubstr(R"({"case": "views, all", "name": "AP50 after", "unit": "%",)"));

  const ProcessOutput judged =
      run_segsim("detector evaluate --weights " + at("after.weights") + " --on " +
                 at("views/train.json"));
  expect_success(judged);
  EXPECT_THAT(judged.text, ::testing::ContainsRegex(
                               "warning: after.weights was trained on ([0-9]+) of the"));
  const ProcessOutput lineage = run_segsim("detector lineage " + at("after.weights"));
  expect_success(lineage);
  EXPECT_THAT(lineage.text, ::testing::ContainsRegex("train +[0-9]+ +tiny \\([0-9a-f]+\\)"));
  EXPECT_THAT(lineage.text, HasSubstr("Every data set is known with its scenes."));

  expect_input_error(run_segsim(compare), "--on");
  expect_input_error(run_segsim(compare + " --on views"), "--on");
  expect_input_error(run_segsim(compare + " --on a=" + at("none.json")), "none.json");
  expect_input_error(run_segsim("label " + at("none") + " --out " + at("v2")), "none");
  std::ofstream(at("cut.weights"), std::ios::binary) << "SEGSIMW1";
  expect_input_error(run_segsim("detector finetune --from " + at("cut.weights") + " --out " +
                                at("x.weights") + options),
                     "cut.weights");
  damage_record(at("after.weights"), at("damaged.weights"));
  for (const char* command : {"detector lineage ", "detector finetune --steps 1 --from "}) {
    std::string line = command + at("damaged.weights");
    if (line.find("finetune") != std::string::npos)
      line += " --out " + at("x.weights") + options;
    expect_input_error(run_segsim(line), "damaged.weights: training.data[0].what");
  }
}

/// A view of one row: `pixels` pixels of each class and id.
core::FrameMasks row_of_masks(const std::vector<std::array<std::uint16_t, 3>>& runs) {
  std::vector<std::uint16_t> classes, ids;
  for (const auto& [pixels, class_id, id] : runs) {
    classes.insert(classes.end(), pixels, class_id);
    ids.insert(ids.end(), pixels, id);
  }
  core::FrameMasks masks;
  masks.semantic = masks.instance =
      core::Image<std::uint16_t>(static_cast<int>(classes.size()), 1);
  masks.semantic.pixels() = classes;
  masks.instance.pixels() = ids;
  masks.confidence = core::Image<std::uint8_t>(static_cast<int>(classes.size()), 1, 255);
  masks.segments = core::segments_of(masks);
  return masks;
}

/// A chair that is found, and one of ten pixels of which six lie on a crowd of chairs.
TEST_F(PerceptionCli, AnnotatedViewsAreATruthAndCrowdsAreCocos) {
  reconstruction::MaskSetInfo info;
  info.source = "by hand";
  info.classes = {{1, "floor", false}, {2, "chair", true}};
  core::FrameMasks truth = row_of_masks({{{10, 2, 5}}, {{20, 2, 9}}, {{30, 1, 0}}});
  const core::FrameMasks found =
      row_of_masks({{{10, 2, 1}}, {{14, 1, 0}}, {{10, 2, 2}}, {{26, 1, 0}}});
  reconstruction::write_masks(at("found"), "0", found, info.classes);
  reconstruction::write_mask_set_info(at("found"), info);
  const std::string measure = "masks measure " + at("found") + " --truth " + at("truth");
  // Floor: 26 of 44 pixels. Chairs: one found, and without the rule one missed, one false.
  for (const auto& [crowd, pq] :
       {std::pair{true, "PQ (IoU > 0.5) 79.5"}, {false, "PQ (IoU > 0.5) 54.5"}}) {
    truth.segments[2].crowd = crowd;  // The floor has id 0, the chair 5, the crowd 9.
    reconstruction::write_masks(at("truth"), "0", truth, info.classes);
    reconstruction::write_mask_set_info(at("truth"), info);
    const ProcessOutput run = run_segsim(measure);
    expect_success(run);
    EXPECT_THAT(run.text, HasSubstr("1 of 1 views"));
    EXPECT_THAT(run.text, HasSubstr(pq));
  }
  // The same with rules by name: the crowd of the last truth is a chair like others.
  const std::string evaluate =
      "evaluate --predictions " + at("found") + " --truth " + at("truth") + " --rules ";
  const ProcessOutput coco = run_segsim(evaluate + "coco --json " + at("coco.json"));
  expect_success(coco);
  EXPECT_THAT(coco.text, HasSubstr("1 views, rules coco"));
  const auto figures = nlohmann::json::parse(core::read_file(at("coco.json")));
  EXPECT_NEAR(figures["pq"].get<double>(), 0.545, 0.001);
  EXPECT_EQ(figures["views"], 1);
  for (const char* rules : {"strict", "zju", "panoptic-lifting"}) {
    expect_success(run_segsim(evaluate + rules));
  }
  EXPECT_EQ(run_segsim(evaluate + "best").exit_code, 2);
  expect_input_error(
      run_segsim("evaluate --predictions " + at("none") + " --truth " + at("truth")), "none");
  reconstruction::write_masks(at("found"), "1", found, info.classes);
  fs::remove(at("found/0_sem.png"));
  expect_input_error(run_segsim(measure),
                     "masks named like the views of truth, for example 0");
}

TEST_F(PerceptionCli, MasksOfModelsAreWhatAReconstructionReads) {
  // The detector finds red cells.
  expect_success(run_segsim("capture --flat 3 --out " + at("cap") +
                            " --frames 40 --width 128 --height 96"));
  (void)perception::write_yolo(folder_.path(), "{0: 'couch', 1: 'bed'}");
  perception::write_sam_encoder(folder_.path());
  perception::write_sam_decoder(folder_.path());
  const std::string detect = "masks detect " + at("cap") + " --detector " + at("yolo.onnx") +
                             " --segmenter " + at("sam.yaml") + " --out " + at("masks") +
                             " --threshold 0.3";
  const ProcessOutput run = run_segsim(detect + " --prompt \"couch. bed.\"");
  expect_success(run);
  EXPECT_THAT(run.text, HasSubstr("in 40 views"));
  EXPECT_THAT(run.text, ::testing::Not(HasSubstr(": 0 masks")));
  EXPECT_TRUE(fs::exists(at("masks/masks.yaml")));
  expect_success(run_segsim("reconstruct " + at("cap") + " --masks " + at("masks") +
                            " --floor-height 0 --voxel 0.1 --iterations 0 "
                            "--label-iterations 4 --out " +
                            at("bundle")));
  expect_success(run_segsim("scene inspect " + at("bundle")));

  expect_input_error(run_segsim(detect + " --prompt \"couch.\""), "masks");  // Not twice.
  expect_input_error(run_segsim(detect + " --overwrite --prompt \"unicorn.\""), "--prompt");
}

TEST_F(PerceptionCli, ARunDrivesWithAModelOfOthersWhereNothingIsTuned) {
  experiments::TinyScene().write(folder_.path() / "tiny");
  (void)perception::write_yolo(folder_.path(), "{0: 'couch', 1: 'chair'}");
  experiments::TinySpec spec{.arms = "  - {name: before, detector: before}\n",
                             .time_limit_s = 2.0,
                             .more = "detectors: {before: \"" + at("yolo.onnx") + "\"}\n"};
  std::ofstream(at("spec.yaml")) << spec.text();
  const std::string run =
      "run " + at("spec.yaml") + " --data " + folder_.path().string() + " --workers 1 --work ";
  const ProcessOutput driven = run_segsim(run + at("work"));
  expect_success(driven);
  EXPECT_THAT(driven.text, HasSubstr("before"));

  // What is tuned must be weights of ours.
  spec.arms = "  - {name: after, detector: after}\n";
  spec.more = "detectors: {before: \"" + at("yolo.onnx") +
              "\", finetune: {views_per_scene: 10, steps: 1}}\n";
  std::ofstream(at("tuning.yaml")) << spec.text();
  expect_input_error(run_segsim("run " + at("tuning.yaml") + " --data " +
                                folder_.path().string() + " --work " + at("tuned")),
                     "yolo.onnx");
}

/// Every network of VLFM in one run: the first detector does not know the goal.
TEST_F(PerceptionCli, APolicyAsksModelsOfOthersAndItsTimesAreABudget) {
  experiments::TinyScene().write(folder_.path() / "tiny");
  fs::create_directories(at("closed"));
  (void)perception::write_yolo(at("closed"), "{0: 'bed', 1: 'chair'}");
  (void)perception::write_yolo(folder_.path(), "{0: 'couch', 1: 'chair'}");
  (void)perception::write_clip(folder_.path(), "clip");
  perception::write_sam_encoder(folder_.path());
  perception::write_sam_decoder(folder_.path());
  (void)perception::write_depth_model(folder_.path());
  const std::string arm = "  - {name: two, detector: before";
  experiments::TinySpec spec{.arms = arm + ", open_detector: \"" + at("yolo.onnx") + "\"}\n",
                             .time_limit_s = 2.0,
                             .more = "detectors: {before: \"" + at("closed/yolo.onnx") +
                                     "\"}\npolicy: {type: vlfm, scorer: {model: \"" +
                                     at("clip.yaml") + "\"}, segmenter: \"" + at("sam.yaml") +
                                     "\", inferred_depth: \"" + at("depth.yaml") + "\"}\n"};
  std::ofstream(at("spec.yaml")) << spec.text();
  const std::string options = " --data " + folder_.path().string() + " --work ";
  const ProcessOutput driven = run_segsim("run " + at("spec.yaml") + options + at("work"));
  expect_success(driven);
  EXPECT_THAT(driven.text, HasSubstr("two"));
  expect_success(run_segsim("export " + at("work") + " --output " + at("rows.jsonl")));
  const std::string rows = core::read_file(at("rows.jsonl"));  // The run, then its trial.
  EXPECT_THAT(rows, AllOf(HasSubstr("model/clip.yaml"), HasSubstr("model/depth.onnx"),
                          HasSubstr("model/yolo.onnx")));
  const auto trial = nlohmann::json::parse(rows.substr(rows.find('\n') + 1));
  EXPECT_EQ(trial["outcome"], "timeout") << trial.dump();

  const std::string measure = "budget measure " + at("spec.yaml") + options + at("measured") +
                              " --trials 1 --id here -o " + at("here.yaml");
  expect_success(run_segsim(measure));
  const std::string budget = core::read_file(at("here.yaml"));
  EXPECT_THAT(budget, AllOf(HasSubstr("id: here"), HasSubstr("detect: {on: cpu"),
                            HasSubstr("policy: {on: cpu")));
  expect_input_error(run_segsim(measure + " --arm three"), "three");

  // Without the second detector nobody knows the goal; a model that is damaged is told first.
  spec.arms = arm + "}\n";
  std::ofstream(at("one.yaml")) << spec.text();
  expect_input_error(run_segsim("run " + at("one.yaml") + options + at("one")), "couch");
  std::ofstream(at("clip.yaml")) << "schema: segsim.model/1\ntask: sam\n";
  expect_input_error(run_segsim("run " + at("spec.yaml") + options + at("damaged")),
                     "clip.yaml");
}

TEST_F(PerceptionCli, BoxesBecomeMasksAndTheSceneIsMeasured) {
  expect_success(run_segsim("capture --flat 3 --out " + at("cap") +
                            " --frames 24 --width 128 --height 96"));
  (void)perception::write_yolo(folder_.path(), "{0: 'couch', 1: 'unicorn'}");
  const std::string make = "masks make " + at("cap") + " --detector " + at("yolo.onnx") +
                           " --out " + at("made") + " --threshold 0.3";
  const ProcessOutput run = run_segsim(make + " --picture " + at("sheet.png"));
  expect_success(run);
  EXPECT_THAT(run.text, HasSubstr("masks of 24 views\n"));
  EXPECT_THAT(run.text, HasSubstr("floor  "));
  EXPECT_TRUE(fs::exists(at("sheet.png")));
  const std::string view = core::read_file(at("made/frame-000003_sem.png"));

  // Stopped before a view was whole, it goes on there and gives the same.
  fs::remove(at("made/masks.yaml"));
  fs::remove(at("made/frame-000003.json"));
  fs::remove(at("made/frame-000003_sem.png"));
  expect_input_error(run_segsim(make + " --other"), "masks of the same recipe");
  const ProcessOutput again = run_segsim(make);
  expect_success(again);
  EXPECT_THAT(again.text, HasSubstr("(23 were there)"));
  EXPECT_EQ(core::read_file(at("made/frame-000003_sem.png")), view);

  const ProcessOutput views =
      run_segsim("masks measure " + at("made") + " --truth " + at("cap"));
  expect_success(views);
  EXPECT_THAT(views.text, HasSubstr("not in the truth, so not measured: unicorn"));
  expect_success(run_segsim("reconstruct " + at("cap") + " --masks " + at("made") +
                            " --voxel 0.1 --iterations 0 --label-iterations 4 --out " +
                            at("scene")));
  const ProcessOutput scene =
      run_segsim("masks measure " + at("scene") + " --truth " + at("cap") +
                 " --held-out-every 8 --record " + at("scene.json"));
  expect_success(scene);
  EXPECT_THAT(scene.text, HasSubstr("3 of 24 views"));
  EXPECT_THAT(core::read_file(at("scene.json")), HasSubstr("\"PQ\""));

  expect_input_error(run_segsim(make), "--overwrite");  // Not twice.
  expect_success(run_segsim(make + " --overwrite --other --frame-step 12"));
  EXPECT_FALSE(fs::exists(at("made/frame-000003.json")));
  expect_input_error(run_segsim(make + " --overwrite --prompt \"sofa.\""), "'sofa'");
  expect_input_error(run_segsim("masks make " + at("cap") + " --detector " + at("none.onnx") +
                                " --out " + at("other")),
                     "none.onnx");
  expect_input_error(run_segsim(make + " --overwrite --picture " + at("sheet.bmp")),
                     "--picture");
}

}  // namespace
}  // namespace segsim
