#include "reconstruction/datasets/coco_panoptic.h"

#include <gmock/gmock.h>
#include <opencv2/imgcodecs.hpp>

#include "core/error.h"
#include "tests/error_message.h"
#include "tests/reconstruction/tiny_sequence.h"

namespace segsim::reconstruction {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::TemporaryFolder;
using testing::write_text;
using tests::input_error_of;

constexpr const char* kCategories =
    R"("categories": [{"id": 1, "name": "person", "isthing": 1},
                      {"id": 200, "name": "floor", "isthing": 0}])";

/// Red, green and blue of an id.
void write_ids(const fs::path& file, const std::vector<std::uint32_t>& ids) {
  fs::create_directories(file.parent_path());
  cv::Mat image(1, static_cast<int>(ids.size()), CV_8UC3);
  for (std::size_t i = 0; i < ids.size(); ++i) {
    image.at<cv::Vec3b>(0, static_cast<int>(i)) =
        cv::Vec3b(static_cast<unsigned char>(ids[i] >> 16),
                  static_cast<unsigned char>(ids[i] >> 8), static_cast<unsigned char>(ids[i]));
  }
  cv::imwrite(file.string(), image);
}

std::string segment(std::uint32_t id, int category, int crowd = 0) {
  return "{\"id\": " + std::to_string(id) + ", \"category_id\": " + std::to_string(category) +
         ", \"iscrowd\": " + std::to_string(crowd) + "}";
}

std::string annotation(const std::string& name, const std::string& segments) {
  return "{\"file_name\": \"" + name + ".png\", \"segments_info\": [" + segments + "]}";
}

constexpr std::uint32_t kLarge = 3 + 256 * 5 + 65536 * 7;

class CocoPanoptic : public ::testing::Test {
 protected:
  /// Two views; person kLarge is in both.
  void SetUp() override {
    write_ids(json_.parent_path() / "truth" / "a.png", {0, kLarge, kLarge, 9, 40});
    write_ids(json_.parent_path() / "truth" / "b.png", {2, kLarge, 9, 9, 9});
    write(annotation("a",
                     segment(kLarge, 1) + ", " + segment(9, 200) + ", " + segment(40, 1, 1)) +
          ", " +
          annotation("b", segment(2, 1) + ", " + segment(kLarge, 1) + ", " + segment(9, 200)));
  }
  void write(const std::string& annotations, const std::string& categories = kCategories) {
    write_text(json_, "{" + (categories.empty() ? "" : categories + ", ") +
                          "\"annotations\": [" + annotations + "]}");
  }
  [[nodiscard]] std::string refusal(const std::string& view = "") const {
    return input_error_of([&] {
      const auto set = open_coco_panoptic(json_, {}, IdScope::kView);
      if (!view.empty()) (void)set->read_as_stored(view);
    });
  }

  TemporaryFolder folder_;
  fs::path json_ = folder_.path() / "truth.json";
};

TEST_F(CocoPanoptic, ColoursAreIdsOfSegments) {
  const auto set = open_coco_panoptic(json_, {}, IdScope::kView);
  EXPECT_THAT(set->names(), ElementsAre("a", "b"));
  EXPECT_EQ(set->info().classes.size(), 2U);
  const core::FrameMasks a = set->read_as_stored("a");
  EXPECT_THAT(a.semantic.pixels(), ElementsAre(0, 1, 1, 200, 1));
  EXPECT_THAT(a.instance.pixels(), ElementsAre(0, 1, 1, 0, 2));
  ASSERT_EQ(a.segments.size(), 3U);
  EXPECT_FALSE(a.segments[1].crowd);
  EXPECT_TRUE(a.segments[2].crowd);
  const core::FrameMasks b = set->read_as_stored("b");
  EXPECT_THAT(b.instance.pixels(), ElementsAre(1, 2, 0, 0, 0)) << "numbered by view";
}

TEST_F(CocoPanoptic, AnObjectOfTheSceneHasOneNumber) {
  const auto set = open_coco_panoptic(json_, {}, IdScope::kScene);
  EXPECT_THAT(set->read_as_stored("a").instance.pixels(), ElementsAre(0, 3, 3, 0, 2));
  EXPECT_THAT(set->read_as_stored("b").instance.pixels(), ElementsAre(1, 3, 0, 0, 0));
}

TEST_F(CocoPanoptic, APredictionTakesTheClassesOfTheTruth) {
  write(annotation("a", segment(kLarge, 7) + ", " + segment(9, 8) + ", " + segment(40, 7)),
        "");
  const std::vector<core::SceneClass> classes{{7, "chair", true}, {8, "wall", false}};
  const auto set = open_coco_panoptic(json_, classes, IdScope::kView);
  EXPECT_THAT(set->read_as_stored("a").semantic.pixels(), ElementsAre(0, 7, 7, 8, 7));
  EXPECT_THAT(refusal(), HasSubstr("categories"));
}

TEST_F(CocoPanoptic, WhatDoesNotFitIsNamed) {
  write(annotation("a", segment(kLarge, 3)));
  EXPECT_THAT(refusal(), HasSubstr("annotations[0].segments_info[0].category_id"));
  write(annotation("a", segment(4, 1) + ", " + segment(4, 1)));
  EXPECT_THAT(refusal(), HasSubstr("not used above"));
  write(annotation("a", segment(9, 200, 1)));
  EXPECT_THAT(refusal(), HasSubstr("iscrowd"));
  write(annotation("a", segment(9, 200)) + ", " + annotation("a", segment(9, 200)));
  EXPECT_THAT(refusal(), HasSubstr("one annotation for a picture"));
  write(annotation("a", segment(9, 200)));
  EXPECT_THAT(refusal("a"), HasSubstr("ids of its segments_info"))
      << "another id is in the picture";
  write(annotation("c", segment(9, 200)));
  EXPECT_THAT(refusal("c"), HasSubstr("c.png"));
  write_text(json_, "{\"annotations\": 3");
  EXPECT_THAT(refusal(), HasSubstr("truth.json"));
  write_text(json_, std::string("{") + kCategories + ", \"annotations\": {}}");
  EXPECT_THAT(refusal(), HasSubstr("annotations"));
}

}  // namespace
}  // namespace segsim::reconstruction
