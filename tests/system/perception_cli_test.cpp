// Labels, detectors and masks by the executable, on a small room.

#include <filesystem>
#include <fstream>
#include <string>

#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "segsim_process.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/perception/tiny_models.h"

namespace segsim {
namespace {

namespace fs = std::filesystem;
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
                              at("report");
  const ProcessOutput run = run_segsim(compare + " --on views=" + at("views/val_views.json"));
  expect_success(run);
  EXPECT_THAT(run.text, HasSubstr("Not checked: whether 'after' was trained on views near"));
  EXPECT_THAT(run.text, HasSubstr("views: after.weights was trained on views of scenes that "
                                  "the images show: tiny"));
  for (const char* file : {"compare.txt", "compare.md", "compare.csv", "compare.json",
                           "precision-views.png", "confusion-views.png", "misses-views.png"}) {
    EXPECT_TRUE(fs::exists(at("report") + "/" + file)) << file;
  }

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

}  // namespace
}  // namespace segsim
