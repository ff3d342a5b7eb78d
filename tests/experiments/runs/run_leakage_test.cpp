// What a run says about what its detectors had seen of its scenes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "experiments/runs/run.h"
#include "perception/checkpoint/lineage.h"
#include "perception/data/image_file.h"
#include "perception/training/training.h"
#include "tests/experiments/start_weights.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

class RunLeakageTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("run_leakage");
    TinyScene().write(folder_->path() / "tiny");
    write_start_weights(folder_->path());
  }
  static void TearDownTestSuite() { delete folder_; }

  /// Everything but the trials.
  static runs::RunReport prepare(const std::string& work, const std::string& arms,
                                 const std::string& detectors = "") {
    TinySpec spec{.arms = arms, .more = detectors};
    runs::RunOptions options;
    options.folders = {folder_->path(), *folder_ / work};
    options.prepare_only = true;
    return runs::run_experiment(specs::parse_spec(spec.text(), "tiny.yaml", options.folders),
                                options);
  }

  static std::string exposure_of_arm(const runs::RunReport& report, const std::string& name) {
    for (const records::ArmRow& arm : report.table.arm_rows) {
      if (arm.name == name && arm.exposure) return records::exposure_text(*arm.exposure);
    }
    return "not there";
  }

  static TemporaryFolder* folder_;
};
TemporaryFolder* RunLeakageTest::folder_ = nullptr;

TEST_F(RunLeakageTest, FilesCarryWhatARunTrainedThemOn) {
  const runs::RunReport tuned = prepare(
      "tuned", "  - {name: before, detector: before}\n  - {name: after, detector: after}\n",
      "detectors:\n  before: ${data}/start.weights\n"
      "  finetune: {views_per_scene: 10, steps: 1}\n");
  EXPECT_EQ(exposure_of_arm(tuned, "before"), "threshold chosen on tiny");
  EXPECT_EQ(exposure_of_arm(tuned, "after"), "trained on tiny; threshold chosen on tiny");
  EXPECT_THAT(tuned.table.notes, Contains(HasSubstr("LEAKAGE scene (*): \"after\"")));
  EXPECT_THAT(tuned.table.notes, Contains(HasSubstr("Leakage none: no view of the evaluation "
                                                    "scenes is in what \"before\" was")));
  EXPECT_THAT(tuned.table.notes,
              Contains(HasSubstr("Score thresholds of \"before\" and \"after\" were chosen")));

  // The same files as arms of another run, which knows nothing of the first; and one of which
  // nobody knows anything.
  perception::DetectorWeights silent =
      perception::read_weights(*folder_ / "tuned/arm-after.weights");
  silent.training = "{}";
  perception::write_weights(*folder_ / "silent.weights", silent);
  const runs::RunReport given =
      prepare("given",
              "  - {name: tuned, detector: \"${data}/tuned/arm-after.weights\"}\n"
              "  - {name: start, detector: \"${data}/start.weights\"}\n"
              "  - {name: silent, detector: \"${data}/silent.weights\"}\n");
  EXPECT_EQ(exposure_of_arm(given, "tuned"), "trained on tiny; threshold chosen on tiny");
  EXPECT_EQ(exposure_of_arm(given, "start"), "none");
  EXPECT_EQ(exposure_of_arm(given, "silent"), "unknown");
  EXPECT_THAT(given.table.notes,
              Contains("LEAKAGE scene: \"tuned\" was trained on views of Two "
                       "rooms."));
  EXPECT_THAT(given.table.notes, Contains(HasSubstr("LEAKAGE unknown: \"silent\"")));
  EXPECT_EQ(given.table.arm_rows[0].tuned_on, "tiny");

  // What was fine-tuned from it inherits that.
  const runs::RunReport again = prepare("again", "  - {name: after, detector: after}\n",
                                        "detectors:\n  before: ${data}/silent.weights\n"
                                        "  finetune: {views_per_scene: 10, steps: 1}\n");
  EXPECT_EQ(exposure_of_arm(again, "after"),
            "partly unknown; trained on tiny; threshold chosen on tiny");
}

TEST_F(RunLeakageTest, ARenamedBundleIsStillTheSameScene) {
  perception::DetectorWeights weights = perception::read_weights(*folder_ / "start.weights");
  perception::DataUse use{perception::DataPurpose::kTrain, 4, std::string(64, 'a')};
  use.scenes = std::vector<perception::ImagedScene>{
      {"known by another name", core::sha256_of_file(*folder_ / "tiny/surfels.ply")}};
  perception::add_data(weights, *folder_ / "start.weights", use);
  perception::write_weights(*folder_ / "other_name.weights", weights);
  const std::string arm = "  - {name: arm, detector: \"${data}/other_name.weights\"}\n";
  EXPECT_EQ(exposure_of_arm(prepare("renamed", arm), "arm"), "trained on tiny");

  use.scenes = std::vector<perception::ImagedScene>{{"tiny", std::string(64, 'b')}};
  weights = perception::read_weights(*folder_ / "start.weights");
  perception::add_data(weights, *folder_ / "start.weights", use);
  perception::write_weights(*folder_ / "other_name.weights", weights);
  const runs::RunReport alike = prepare("alike", arm);
  EXPECT_EQ(exposure_of_arm(alike, "arm"), "another scene named tiny");
  EXPECT_THAT(alike.table.notes, Not(Contains(HasSubstr("Leakage none"))));
}

}  // namespace
}  // namespace segsim::experiments
