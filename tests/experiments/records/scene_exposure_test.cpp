#include "experiments/detection/weights_exposure.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/detection/seen_data.h"
#include "experiments/detection/source_dataset.h"
#include "perception/checkpoint/lineage.h"
#include "tests/error_message.h"
#include "tests/temporary_folder.h"
#include "worlds/procedural/procedural_flat.h"
#include "worlds/procedural/source_domain.h"

namespace segsim::experiments {
namespace {

using perception::DataPurpose;
using perception::DataUse;
using perception::ImagedScene;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::string kFlatHash(64, 'a'), kHouseHash(64, 'b'), kOtherHash(64, 'c');

DataUse use_of(DataPurpose purpose, std::optional<std::vector<ImagedScene>> scenes) {
  DataUse use{purpose, 3, kOtherHash};
  use.image_hashes = {10, 20, 30};
  use.scenes = std::move(scenes);
  return use;
}

ImagedScene rooms(const std::string& generator, std::uint64_t first, std::uint64_t last) {
  return {.generator = generator, .first_seed = first, .last_seed = last};
}

class SceneExposureTest : public testing::Test {
 protected:
  SceneExposureTest() : folder_("scene_exposure") {
    flat_.name = "flat-3";
    flat_.surfels.sha256 = kFlatHash;
    house_.name = "villa";  // The spec calls it otherwise.
    house_.surfels.sha256 = kHouseHash;
  }

  /// Weights with this record; none without.
  [[nodiscard]] std::filesystem::path weights(const std::vector<DataUse>& data) const {
    perception::DetectorWeights weights;
    weights.class_names = {"chair"};
    weights.tensors = {{"bias", {1}, {0.5F}}};
    if (!data.empty()) weights.training = perception::with_data("{}", data);
    perception::write_weights(folder_ / "w.weights", weights);
    return folder_ / "w.weights";
  }
  [[nodiscard]] records::SceneExposure exposure(const std::vector<DataUse>& data) const {
    const std::vector<detection::EvaluationScene> scenes{{"flat-3", &flat_, 3},
                                                         {"house", &house_}};
    return detection::exposure_of(weights(data), scenes);
  }

  tests::TemporaryFolder folder_;
  core::SceneManifest flat_, house_;
};

TEST_F(SceneExposureTest, AFileWithoutARecordMayHaveSeenAnything) {
  EXPECT_EQ(records::exposure_text(exposure({})), "unknown");
  // Nor does a threshold that is chosen here make its past known.
  EXPECT_EQ(
      records::exposure_text(exposure(
          {perception::foreign_data("n.pt", kOtherHash),
           use_of(DataPurpose::kValidation, std::vector<ImagedScene>{{"x", kHouseHash}})})),
      "unknown; threshold chosen on house");
  // A model of others has no place for one.
  folder_.write("m.onnx", "not read");
  const std::vector<detection::EvaluationScene> scenes{{"flat-3", &flat_}};
  EXPECT_EQ(records::exposure_text(detection::exposure_of(folder_ / "m.onnx", scenes)),
            "unknown");
}

TEST_F(SceneExposureTest, OtherScenesAreNoLeak) {
  const records::SceneExposure clean = exposure({use_of(
      DataPurpose::kTrain,
      std::vector<ImagedScene>{rooms(worlds::kRoomGenerator, 1, 250), {"lab", kOtherHash}})});
  EXPECT_EQ(records::exposure_text(clean), "none");
}

TEST_F(SceneExposureTest, AKnownSceneUnderAnotherNameIsFoundByItsHash) {
  const records::SceneExposure leak =
      exposure({use_of(DataPurpose::kMix, std::vector<ImagedScene>{{"renamed", kHouseHash}})});
  EXPECT_EQ(records::exposure_text(leak), "trained on house");
  EXPECT_TRUE(leak.is_trained_on("house"));
  EXPECT_FALSE(leak.is_trained_on("flat-3"));
}

TEST_F(SceneExposureTest, AnotherSceneOfTheSameNameIsAHint) {
  for (const char* name : {"house", "villa"}) {
    const records::SceneExposure hint =
        exposure({use_of(DataPurpose::kTrain, std::vector<ImagedScene>{{name, kOtherHash}})});
    EXPECT_EQ(records::exposure_text(hint), "another scene named house");
  }
}

TEST_F(SceneExposureTest, AFlatIsKnownByItsSeedToo) {
  const auto text = [&](const ImagedScene& scene) {
    return records::exposure_text(
        exposure({use_of(DataPurpose::kTrain, std::vector<ImagedScene>{scene})}));
  };
  EXPECT_EQ(text(rooms(worlds::kFlatGenerator, 1, 3)), "trained on flat-3");
  EXPECT_EQ(text(rooms(worlds::kFlatGenerator, 4, 9)), "none");
  EXPECT_EQ(text(rooms(worlds::kRoomGenerator, 1, 9)), "none");
}

TEST_F(SceneExposureTest, AThresholdIsNotATraining) {
  const records::SceneExposure mild = exposure(
      {use_of(DataPurpose::kTrain, std::vector<ImagedScene>{}),
       use_of(DataPurpose::kValidation, std::vector<ImagedScene>{{"flat-3", kFlatHash}})});
  EXPECT_EQ(records::exposure_text(mild), "threshold chosen on flat-3");
}

TEST_F(SceneExposureTest, OneUnknownSetMakesThePastPartlyUnknown) {
  EXPECT_EQ(records::exposure_text(exposure(
                {use_of(DataPurpose::kTrain, std::vector<ImagedScene>{{"f", kFlatHash}}),
                 use_of(DataPurpose::kMix, std::nullopt)})),
            "partly unknown; trained on flat-3");
}

TEST_F(SceneExposureTest, TextAndBack) {
  records::SceneExposure exposure;
  for (const records::TrainingDataKnown known :
       {records::TrainingDataKnown::kAll, records::TrainingDataKnown::kPart,
        records::TrainingDataKnown::kNothing}) {
    exposure = {};
    exposure.known = known;
    EXPECT_EQ(records::parse_exposure(records::exposure_text(exposure)), exposure);
    exposure.trained_on = {"a", "b-1"};
    exposure.threshold_on = {"b-1"};
    exposure.same_name = {"c", "d", "e_2"};
    EXPECT_EQ(records::parse_exposure(records::exposure_text(exposure)), exposure);
  }
  EXPECT_EQ(records::parse_exposure("seen in a dream").known,
            records::TrainingDataKnown::kNothing);
  EXPECT_EQ(records::parse_exposure("").known, records::TrainingDataKnown::kNothing);
}

TEST_F(SceneExposureTest, TheShippedWeightsSayWhatTheyWereTrainedOn) {
  const std::vector<detection::EvaluationScene> scenes{{"flat-3", &flat_, 3},
                                                       {"house", &house_}};
  EXPECT_EQ(records::exposure_text(detection::exposure_of(SEGSIM_SHIPPED_WEIGHTS, scenes)),
            "none");
}

TEST_F(SceneExposureTest, ImagesOfATestThatWereTrainedOnAreCounted) {
  const auto file =
      weights({use_of(DataPurpose::kTrain, std::vector<ImagedScene>{{"f", kFlatHash}}), [] {
                 DataUse use = use_of(DataPurpose::kValidation,
                                      std::vector<ImagedScene>{{"h", kHouseHash}});
                 use.image_hashes = {40, 50, 60};
                 return use;
               }()});
  DataUse tested =
      use_of(DataPurpose::kValidation, std::vector<ImagedScene>{{"v", kOtherHash}});
  tested.image_hashes = {20, 30, 60};
  detection::SeenData seen = detection::seen_data(file, tested);
  EXPECT_THAT(seen.warnings,
              ElementsAre("w.weights was trained on 2 of the 3 images",
                          "the score threshold of w.weights was chosen on 1 of the 3 images"));
  EXPECT_THAT(seen.unknown, IsEmpty());

  tested.image_hashes = {1, 2, 3};
  EXPECT_THAT(detection::seen_data(file, tested).warnings, IsEmpty());
  tested.scenes = std::vector<ImagedScene>{{"v", kFlatHash}, {"house", kHouseHash}};
  EXPECT_THAT(detection::seen_data(file, tested).warnings,
              ElementsAre("w.weights was trained on views of scenes that the images show: v"));
  tested.scenes.reset();
  EXPECT_THAT(detection::seen_data(file, tested).unknown,
              ElementsAre(HasSubstr("not known: which scenes the images show")));
  EXPECT_THAT(detection::seen_data(weights({}), tested).unknown.front(),
              HasSubstr("that w.weights was trained on (w.weights)"));
}

}  // namespace
}  // namespace segsim::experiments
