#include "experiments/trials/policy_models.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "experiments/trials/routed_detector.h"
#include "nav/mapping/depth_inference.h"
#include "nav/objects/segmenter.h"
#include "nav/value/image_text_scorer.h"
#include "perception/models/prompt_segmenter.h"
#include "tests/perception/clip_model.h"
#include "tests/perception/depth_model.h"
#include "tests/perception/tiny_models.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

using core::Image;
using core::Rgb8;
using testing::ElementsAre;

core::Observation seen(const Image<Rgb8>& image) {
  core::Observation observation;
  observation.rgb = &image;
  return observation;
}

TEST(PolicyModels, AnImageTextModelScoresTheTarget) {
  const tests::TemporaryFolder folder;
  const std::filesystem::path clip = perception::write_clip(folder / "", "clip");
  trials::LoadedPolicyModels models;
  const auto scorer = models.loaders().scorer(clip, "{}");
  const Image<Rgb8> red(40, 30, {255, 0, 0}), blue(40, 30, {0, 0, 255});
  const double chair = scorer->score(seen(red), {}, {"chair"});
  EXPECT_GT(chair, scorer->score(seen(blue), {}, {"chair"}));
  EXPECT_LE(chair, 1.0);
  EXPECT_EQ(scorer->score(seen(red), {}, {"table"}), 0.0)
      << "a cosine below 0 promises nothing";
  EXPECT_EQ(models.loaders().scorer(clip, "{}"), scorer) << "loaded once";
  EXPECT_NE(models.loaders().scorer(clip, "a {}"), scorer);
}

TEST(PolicyModels, ASegmentersMaskIsThatOfTheModel) {
  const tests::TemporaryFolder folder;
  perception::write_sam_encoder(folder / "");
  perception::write_sam_decoder(folder / "", "point_coords");
  const std::filesystem::path sam = folder / "sam.yaml";
  trials::LoadedPolicyModels models;
  const auto segmenter = models.loaders().segmenter(sam);
  const Image<Rgb8> image(128, 96);
  const core::BoxPx box{16, 24, 80, 64};
  const Image<std::uint8_t> mask = segmenter->segment(seen(image), box);
  EXPECT_EQ(mask.width_px(), 128);
  EXPECT_EQ(mask(48, 44), 1);
  EXPECT_EQ(mask(100, 80), 0);
}

TEST(PolicyModels, DepthIsInferredFromColours) {
  const tests::TemporaryFolder folder;
  const std::filesystem::path model = perception::write_depth_model(folder / "");
  trials::LoadedPolicyModels models;
  Image<float> depth_m;
  models.loaders().depth(model)->infer(seen(Image<Rgb8>(20, 10, {255, 255, 255})), depth_m);
  ASSERT_EQ(depth_m.width_px(), 20);
  EXPECT_NEAR(depth_m(7, 4), 1.0F, 1e-6F);
}

TEST(PolicyModels, ADamagedModelIsToldWhenItIsLoaded) {
  const tests::TemporaryFolder folder;
  perception::write_text(folder / "clip.yaml", "schema: segsim.model/1\ntask: clip\n");
  trials::LoadedPolicyModels models;
  EXPECT_THROW((void)models.loaders().scorer(folder / "clip.yaml", "{}"), core::InputError);
}

/// Finds one object of each of its classes that `finds` names.
class FakeDetector final : public core::Detector {
 public:
  FakeDetector(std::vector<std::string> names, std::vector<int> finds, float score)
      : names_(std::move(names)), finds_(std::move(finds)), score_(score) {}
  const std::vector<std::string>& class_names() const override { return names_; }
  std::vector<core::Detection> detect(const core::Observation&) override {
    ++calls;
    std::vector<core::Detection> found;
    for (const int index : finds_) {
      core::Detection detection;
      detection.class_index = index;
      detection.score = score_;
      found.push_back(detection);
    }
    return found;
  }
  int calls = 0;

 private:
  std::vector<std::string> names_;
  std::vector<int> finds_;
  float score_;
};

std::vector<int> classes_of(const std::vector<core::Detection>& detections) {
  std::vector<int> classes;
  for (const core::Detection& d : detections) classes.push_back(d.class_index);
  return classes;
}

TEST(RoutedDetector, TheOpenSetIsAskedForWhatTheClosedOneLacks) {
  auto closed = std::make_unique<FakeDetector>(std::vector<std::string>{"chair", "couch"},
                                               std::vector<int>{0}, 0.5F);
  auto open = std::make_unique<FakeDetector>(std::vector<std::string>{"couch", "door"},
                                             std::vector<int>{0, 1}, 0.7F);
  FakeDetector& opened = *open;
  FakeDetector& first = *closed;
  trials::RoutedDetector detector(std::move(closed), std::move(open));
  EXPECT_THAT(detector.class_names(), ElementsAre("chair", "couch", "door"));
  const Image<Rgb8> image(4, 4);

  detector.set_route({true, false}, "chair");
  EXPECT_THAT(classes_of(detector.detect(seen(image))), ElementsAre(0));
  EXPECT_EQ(opened.calls, 0);

  detector.set_route({false, true}, "door");
  EXPECT_THAT(classes_of(detector.detect(seen(image))), ElementsAre(1, 2));
  EXPECT_EQ(first.calls, 1);

  detector.set_route({true, true}, "chair");  // Found: nobody else is asked.
  EXPECT_THAT(classes_of(detector.detect(seen(image))), ElementsAre(0));
  detector.set_route({true, true}, "couch");  // Best score first.
  EXPECT_THAT(classes_of(detector.detect(seen(image))), ElementsAre(1, 2, 0));
}

}  // namespace
}  // namespace segsim::experiments
