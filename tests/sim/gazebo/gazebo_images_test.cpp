// Pixels in the encodings of Gazebo's sensors.

#include "sim/gazebo/gazebo_images.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/error_message.h"

namespace segsim::sim {
namespace {

core::SceneManifest two_chairs() {
  core::SceneManifest scene;
  scene.name = "test";
  scene.classes = {{1, "floor", false}, {7, "chair", true}, {255, "couch", true}};
  scene.instances = {{40, 7, "b", {}, {}}, {12, 7, "a", {}, {}}, {300, 255, "c", {}, {}}};
  return scene;
}

/// One row of (class, instance).
core::Frame row(const std::vector<std::pair<std::uint16_t, std::uint16_t>>& pixels) {
  core::Frame frame;
  frame.semantic.resize(static_cast<int>(pixels.size()), 1);
  frame.instance.resize(static_cast<int>(pixels.size()), 1);
  for (int x = 0; x < static_cast<int>(pixels.size()); ++x) {
    frame.semantic(x, 0) = pixels[static_cast<std::size_t>(x)].first;
    frame.instance(x, 0) = pixels[static_cast<std::size_t>(x)].second;
  }
  return frame;
}

std::vector<int> values(const std::string& bytes) {
  std::vector<int> numbers;
  for (const char byte : bytes) numbers.push_back(static_cast<unsigned char>(byte));
  return numbers;
}

TEST(GazeboImages, ColourIsBytesInOrder) {
  core::Image<core::Rgb8> rgb(2, 2);
  rgb(0, 0) = {1, 2, 3};
  rgb(1, 0) = {4, 5, 6};
  rgb(0, 1) = {7, 8, 9};
  rgb(1, 1) = {250, 251, 252};
  std::string bytes = "rest of another image";
  encode_rgb(rgb, bytes);
  EXPECT_THAT(values(bytes), ::testing::ElementsAre(1, 2, 3, 4, 5, 6, 7, 8, 9, 250, 251, 252));
}

TEST(GazeboImages, DepthHasInfinitiesOutsideTheClippingPlanes) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  core::Image<float> depth_m(6, 1);
  depth_m.pixels() = {kNan, 0.05F, 0.3F, 7.25F, 20.0F, 31.0F};
  std::string bytes;
  encode_depth(depth_m, 0.1, 20.0, bytes);
  std::vector<float> out(6);
  ASSERT_EQ(bytes.size(), 24U);
  std::memcpy(out.data(), bytes.data(), bytes.size());
  constexpr float kInf = std::numeric_limits<float>::infinity();
  EXPECT_THAT(out, ::testing::ElementsAre(kInf, -kInf, 0.3F, 7.25F, kInf, kInf));
}

TEST(GazeboImages, PanopticLabelsCountWithinTheirClass) {
  const GazeboLabelEncoder encoder(two_chairs());
  std::string bytes;
  encoder.encode_labels(row({{0, 0}, {1, 0}, {7, 12}, {7, 40}, {255, 300}, {0, 12}}),
                        GazeboLabels::kPanoptic, bytes);
  EXPECT_THAT(values(bytes), ::testing::ElementsAre(0, 0, 0,    // background
                                                    1, 0, 1,    // floor: one of its kind
                                                    1, 0, 7,    // chair with the lesser id
                                                    2, 0, 7,    // the other
                                                    1, 0, 255,  // couch
                                                    0, 0, 0));
}

TEST(GazeboImages, CountsAbove255GoIntoTheSecondByte) {
  core::SceneManifest scene;
  scene.classes = {{3, "book", true}};
  for (std::uint16_t id = 1; id <= 600; ++id) scene.instances.push_back({id, 3, "", {}, {}});
  const GazeboLabelEncoder encoder(scene);
  std::string bytes;
  encoder.encode_labels(row({{3, 255}, {3, 256}, {3, 600}}), GazeboLabels::kPanoptic, bytes);
  EXPECT_THAT(values(bytes), ::testing::ElementsAre(255, 0, 3, 0, 1, 3, 88, 2, 3));
}

TEST(GazeboImages, SemanticLabelsFillAllThreeBytes) {
  const GazeboLabelEncoder encoder(two_chairs());
  std::string bytes;
  encoder.encode_labels(row({{0, 0}, {7, 12}, {7, 40}}), GazeboLabels::kSemantic, bytes);
  EXPECT_THAT(values(bytes), ::testing::ElementsAre(0, 0, 0, 7, 7, 7, 7, 7, 7));
}

TEST(GazeboImages, ColoursTellInstancesApart) {
  const GazeboLabelEncoder encoder(two_chairs());
  const core::Frame frame = row({{0, 0}, {1, 0}, {7, 12}, {7, 40}, {255, 300}, {7, 12}});
  std::string bytes;
  encoder.encode_colors(frame, GazeboLabels::kPanoptic, bytes);
  std::set<std::string> colors;
  for (std::size_t i = 0; i < 6; ++i) colors.insert(bytes.substr(3 * i, 3));
  EXPECT_EQ(colors.size(), 5U);
  EXPECT_EQ(bytes.substr(0, 3), std::string(3, '\0'));
  encoder.encode_colors(frame, GazeboLabels::kSemantic, bytes);
  EXPECT_EQ(bytes.substr(6, 3), bytes.substr(9, 3));
}

TEST(GazeboImages, ClassesBeyondAByteAreRefused) {
  core::SceneManifest scene = two_chairs();
  scene.classes.push_back({256, "lamp", true});
  EXPECT_THAT(tests::input_error_of([&] { GazeboLabelEncoder encoder(scene); }),
              ::testing::AllOf(::testing::HasSubstr("lamp"), ::testing::HasSubstr("256")));
}

}  // namespace
}  // namespace segsim::sim
