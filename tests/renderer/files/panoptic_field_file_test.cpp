#include "renderer/files/panoptic_field_file.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "renderer/cpu_renderer.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::renderer {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class PanopticFieldFileTest : public ::testing::Test {
 protected:
  PanopticFieldFileTest()
      : folder_(fs::temp_directory_path() /
                ("segsim_field_file_" + std::to_string(::getpid()))) {
    fs::create_directories(folder_);
    cloud_ = testing::random_scene(5, 300);
    testing::add_random_features(cloud_, 9);
    field_ = fold_panoptic_model(cloud_, testing::random_model(2, 11, 50, 0.3F));
  }
  ~PanopticFieldFileTest() override { fs::remove_all(folder_); }

  [[nodiscard]] fs::path file() const { return folder_ / kPanopticFieldFileName; }
  [[nodiscard]] std::string refusal(std::size_t surfels = 300) const {
    try {
      (void)read_panoptic_field(file(), surfels);
    } catch (const core::InputError& error) {
      return error.what();
    }
    return "accepted";
  }
  void overwrite(std::size_t at, char value) const {
    std::string bytes = core::read_file(file());
    bytes.at(at) = value;
    std::ofstream(file(), std::ios::binary) << bytes;
  }

  fs::path folder_;
  SurfelCloud cloud_;
  PanopticField field_;
};

void expect_same(const SparseScores& a, const SparseScores& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a.row_capacity(), b.row_capacity());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a.base(i), b.base(i));
    ASSERT_EQ(a.row(i).size(), b.row(i).size());
    for (std::size_t k = 0; k < a.row(i).size(); ++k) {
      EXPECT_EQ(a.row(i)[k].index, b.row(i)[k].index);
      EXPECT_EQ(a.row(i)[k].excess, b.row(i)[k].excess);
    }
  }
}

TEST_F(PanopticFieldFileTest, ComesBackExactly) {
  field_.instance_class.assign(field_.instance_id.size(), 0);
  field_.instance_class.back() = field_.class_id.front();
  write_panoptic_field(file(), field_);
  const PanopticField read = read_panoptic_field(file(), 300);
  expect_same(read.classes, field_.classes);
  expect_same(read.instances, field_.instances);
  EXPECT_EQ(read.class_id, field_.class_id);
  EXPECT_EQ(read.class_is_thing, field_.class_is_thing);
  EXPECT_EQ(read.instance_id, field_.instance_id);
  EXPECT_EQ(read.instance_class, field_.instance_class);
  EXPECT_EQ(read.dropped_classes.mean, field_.dropped_classes.mean);
  EXPECT_EQ(read.dropped_instances.max, field_.dropped_instances.max);
}

TEST_F(PanopticFieldFileTest, DrawsTheSamePicture) {
  write_panoptic_field(file(), field_);
  const auto cloud = std::make_shared<const SurfelCloud>(cloud_);
  const auto camera = core::CameraIntrinsics::from_fov(64, 48, 1.2);
  const core::CameraPose pose;
  const auto draw = [&](PanopticField field) {
    return make_cpu_renderer(cloud, {},
                             std::make_shared<const PanopticField>(std::move(field)))
        ->render(pose, camera, core::Channels::kAll);
  };
  const core::Frame before = draw(field_), after = draw(read_panoptic_field(file(), 300));
  EXPECT_EQ(before.semantic.pixels(), after.semantic.pixels());
  EXPECT_EQ(before.instance.pixels(), after.instance.pixels());
  EXPECT_EQ(before.confidence.pixels(), after.confidence.pixels());
}

TEST_F(PanopticFieldFileTest, EmptyFieldComesBack) {
  write_panoptic_field(file(), PanopticField{});
  EXPECT_EQ(read_panoptic_field(file(), 0).size(), 0U);
}

TEST_F(PanopticFieldFileTest, WrongFilesAreRefused) {
  EXPECT_THAT(refusal(), HasSubstr("labels.bin"));  // Not there.
  write_panoptic_field(file(), field_);
  EXPECT_EQ(refusal(), "accepted");
  EXPECT_THAT(refusal(299), HasSubstr("expected distributions of 299 surfels, found 300"));
  overwrite(200, '!');
  EXPECT_THAT(refusal(), HasSubstr("expected a payload with the SHA-256 of its header"));
  write_panoptic_field(file(), field_);
  overwrite(8, 2);
  EXPECT_THAT(refusal(), HasSubstr("expected version 1, found 2"));
  overwrite(0, 'X');
  EXPECT_THAT(refusal(), HasSubstr("expected label distributions (SEGSIMLD)"));
  write_panoptic_field(file(), field_);
  fs::resize_file(file(), fs::file_size(file()) - 10);
  EXPECT_THAT(refusal(), HasSubstr("bytes of payload"));
  fs::resize_file(file(), 0);
  EXPECT_THAT(refusal(), HasSubstr("0 other bytes"));
}

}  // namespace
}  // namespace segsim::renderer
