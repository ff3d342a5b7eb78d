#include "reconstruction/training/training_pack.h"

#include <fstream>

#include <gmock/gmock.h>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"

namespace segsim::reconstruction {
namespace {

using ::testing::HasSubstr;

constexpr int kWidth_px = 3, kHeight_px = 2;

TrainingView view(std::uint8_t number) {
  TrainingView view;
  view.T_world_camera =
      core::CameraPose(glm::dquat(0.6, 0.0, 0.8, 0.0), glm::dvec3(number, 2.0, -1.5));
  view.rgb = {kWidth_px, kHeight_px, core::Rgb8{number, 7, 9}};
  view.depth_m = {kWidth_px, kHeight_px, 1.25F + static_cast<float>(number)};
  view.masks.semantic = {kWidth_px, kHeight_px, std::uint16_t{300}};
  view.masks.instance = {kWidth_px, kHeight_px, std::uint16_t{number}};
  view.masks.confidence = {kWidth_px, kHeight_px, std::uint8_t{128}};
  return view;
}

TrainingSet two_and_one() {
  TrainingSet set;
  set.intrinsics = {kWidth_px, kHeight_px, 4.0, 5.0, 1.5, 1.0};
  set.classes = {{4, "wall", false}, {300, "chair", true}};
  set.training = {view(1), view(2)};
  set.held_out = {view(3)};
  set.training[0].frame = 0;
  set.training[1].frame = 2;
  set.held_out[0].frame = 1;
  return set;
}

renderer::SurfelCloud two_surfels() {
  renderer::SurfelCloud cloud;
  cloud.position_m = {{1.0F, 2.0F, 3.0F}, {-4.0F, 5.0F, 6.5F}};
  cloud.R_world_surfel = {{1.0F, 0.0F, 0.0F, 0.0F}, {0.6F, 0.0F, 0.8F, 0.0F}};
  cloud.scale_m = {{0.5F, 0.25F}, {0.1F, 0.2F}};
  cloud.opacity = {0.9F, 0.3F};
  cloud.sh = {{0.1F, 0.2F, 0.3F}, {-0.4F, 0.5F, 0.6F}};
  return cloud;
}

class TrainingPackFile : public ::testing::Test {
 protected:
  [[nodiscard]] std::string error() const {
    try {
      (void)read_training_pack(file_);
    } catch (const core::InputError& e) {
      return e.what();
    }
    return "no error";
  }
  ~TrainingPackFile() override { std::filesystem::remove(file_); }
  std::filesystem::path file_ =
      std::filesystem::path(::testing::TempDir()) /
      (std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()) +
       ".set.pack");
};

TEST_F(TrainingPackFile, ComesBackAsItWas) {
  write_training_pack(file_, two_and_one(), two_surfels());
  const TrainingPack pack = read_training_pack(file_);
  EXPECT_EQ(pack.set.intrinsics.width_px, kWidth_px);
  EXPECT_EQ(pack.set.intrinsics.fy_px, 5.0);
  EXPECT_EQ(pack.set.intrinsics.cx_px, 1.5);
  ASSERT_EQ(pack.set.classes.size(), 2U);
  EXPECT_EQ(pack.set.classes[1].id, 300);
  EXPECT_TRUE(pack.set.classes[1].thing);
  ASSERT_EQ(pack.set.training.size(), 2U);
  EXPECT_EQ(pack.set.training[1].frame, 2U);
  EXPECT_EQ(pack.set.held_out.at(0).frame, 1U);
  ASSERT_EQ(pack.set.held_out.size(), 1U);
  const TrainingView& last = pack.set.held_out[0];
  EXPECT_EQ(last.T_world_camera.translation_m(), glm::dvec3(3.0, 2.0, -1.5));
  EXPECT_EQ(last.T_world_camera.rotation().y, 0.8);
  EXPECT_EQ(last.rgb(2, 1).r, 3);
  EXPECT_EQ(last.depth_m(2, 1), 4.25F);
  EXPECT_EQ(last.masks.semantic(2, 1), 300);
  EXPECT_EQ(last.masks.instance(2, 1), 3);
  EXPECT_EQ(last.masks.confidence(2, 1), 128);
  ASSERT_EQ(last.masks.segments.size(), 1U);
  EXPECT_EQ(last.masks.segments[0].area_px, kWidth_px * kHeight_px);
  ASSERT_EQ(pack.start.size(), 2U);
  EXPECT_EQ(pack.start.position_m[1], glm::vec3(-4.0F, 5.0F, 6.5F));
  EXPECT_NEAR(pack.start.scale_m[0].y, 0.25F, 1e-6F);
  EXPECT_NEAR(pack.start.opacity[1], 0.3F, 1e-6F);
  EXPECT_NEAR(pack.start.R_world_surfel[1].y, 0.8F, 1e-6F);
  EXPECT_EQ(pack.start.sh[1], glm::vec3(-0.4F, 0.5F, 0.6F));
}

TEST_F(TrainingPackFile, CutAtAnyLengthIsAnError) {
  write_training_pack(file_, two_and_one(), two_surfels());
  const std::string whole = core::read_file(file_);
  for (std::size_t length = 0; length < whole.size(); ++length) {
    std::ofstream(file_, std::ios::binary) << whole.substr(0, length);
    EXPECT_THAT(error(), HasSubstr("set.pack")) << length;
  }
}

TEST_F(TrainingPackFile, OtherFilesAndImpossibleCountsAreErrors) {
  EXPECT_THAT(error(), HasSubstr("no readable file"));
  std::ofstream(file_, std::ios::binary) << "ply\nformat binary_little_endian 1.0\n";
  EXPECT_THAT(error(), HasSubstr("training pack of version 2"));
  write_training_pack(file_, two_and_one(), two_surfels());
  std::string bytes = core::read_file(file_);
  bytes[12] = '\xFF', bytes[15] = '\xFF';  // Width.
  std::ofstream(file_, std::ios::binary) << bytes;
  EXPECT_THAT(error(), HasSubstr("width"));
}

TEST_F(TrainingPackFile, AViewWithoutDepthIsTheCallersMistake) {
  TrainingSet set = two_and_one();
  set.training[0].depth_m = {};
  EXPECT_THROW(write_training_pack(file_, set, two_surfels()), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::reconstruction
