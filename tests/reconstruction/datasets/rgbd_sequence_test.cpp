#include "reconstruction/datasets/rgbd_sequence.h"

#include <cmath>
#include <functional>
#include <string>
#include <thread>

#include <gmock/gmock.h>

#include "core/error.h"
#include "core/file_io.h"
#include "reconstruction/datasets/floor_fit.h"
#include "renderer/files/exr_io.h"
#include "tests/error_message.h"
#include "tests/reconstruction/tiny_sequence.h"

namespace segsim::reconstruction {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::TemporaryFolder;
using tests::input_error_of;

std::string open_error(const std::filesystem::path& folder,
                       const SequenceOptions& options = {}) {
  return input_error_of([&] { (void)open_sequence(folder, options); });
}

SequenceOptions with_floor(double floor_m) {
  SequenceOptions options;
  options.floor_height_m = floor_m;
  return options;
}

TEST(RgbdSequence, ReadsHololensWithItsConventions) {
  const TemporaryFolder folder("hololens");
  testing::write_hololens(folder.path());
  const auto sequence = open_sequence(folder.path(), with_floor(-1.5));
  ASSERT_EQ(sequence->frame_count(), 3U);
  EXPECT_EQ(sequence->frame_name(2), "00007");
  EXPECT_EQ(sequence->intrinsics().width_px, 16);
  EXPECT_DOUBLE_EQ(sequence->intrinsics().cx_px, 8.0);  // Integer centres: + 0.5.
  EXPECT_DOUBLE_EQ(sequence->intrinsics().cy_px, 6.0);
  EXPECT_FALSE(sequence->has_masks());
  EXPECT_TRUE(sequence->warnings().empty());

  const RgbdFrame frame = sequence->load(1);
  // Line 2 of poses.txt is (2, 2, 3): (x, y, z) -> (x, -z, y + 1.5).
  const glm::dvec3 position = frame.T_world_camera.translation_m();
  EXPECT_NEAR(position.x, 2.0, 1e-9);
  EXPECT_NEAR(position.y, -3.0, 1e-9);
  EXPECT_NEAR(position.z, 3.5, 1e-9);
  // The camera's z axis is the source's z axis, which is our -y.
  const glm::dvec3 forward = frame.T_world_camera.rotation() * glm::dvec3(0, 0, 1);
  EXPECT_NEAR(forward.y, -1.0, 1e-9);
  EXPECT_TRUE(std::isnan(frame.depth_m(0, 0)));  // 0
  EXPECT_TRUE(std::isnan(frame.depth_m(1, 0)));  // 65535
  EXPECT_FLOAT_EQ(frame.depth_m(7, 5), 1.007F);
  EXPECT_EQ(frame.rgb(0, 0), (core::Rgb8{10, 20, 30}));
  EXPECT_EQ(frame.rgb(15, 0), (core::Rgb8{200, 100, 50}));
}

TEST(RgbdSequence, ReadsSevenScenesWithMasksAndLabels) {
  const TemporaryFolder folder("seven");
  testing::write_seven_scenes(folder.path(), true);
  // labels.yaml wins over these options.
  SequenceOptions options = with_floor(9.0);
  options.up_axis = UpAxis::kY;
  const auto sequence = open_sequence(folder.path(), options);
  ASSERT_EQ(sequence->frame_count(), 2U);
  EXPECT_EQ(sequence->frame_name(1), "frame-000002");
  EXPECT_DOUBLE_EQ(sequence->intrinsics().cx_px, 7.5);
  ASSERT_EQ(sequence->classes().size(), 1U);
  EXPECT_EQ(sequence->classes()[0].name, "chair");
  ASSERT_EQ(sequence->instances().size(), 1U);
  EXPECT_EQ(sequence->instances()[0].class_id, 3);
  const RgbdFrame frame = sequence->load(1);
  EXPECT_NEAR(frame.T_world_camera.translation_m().z, 3.0, 1e-9);
  EXPECT_EQ(frame.semantic(4, 4), 3);
  EXPECT_EQ(frame.instance(4, 4), 700);
  EXPECT_EQ(frame.instance(0, 0), 0);
}

TEST(RgbdSequence, CrowdsOfTheLabelsFileAreToldWithEveryFrame) {
  const TemporaryFolder folder("crowds");
  testing::write_seven_scenes(folder.path(), true);
  EXPECT_TRUE(open_sequence(folder.path())->load(0).crowds.empty());
  const auto file = folder.path() / "labels.yaml";
  std::string text = core::read_file(file);
  const std::size_t entry = text.find("id: 700");
  ASSERT_NE(entry, std::string::npos);
  text.insert(entry, "iscrowd: true, ");
  testing::write_text(file, text);
  EXPECT_THAT(open_sequence(folder.path())->load(0).crowds, ::testing::ElementsAre(700));
}

TEST(RgbdSequence, PrefersFloatDepth) {
  const TemporaryFolder folder("exr");
  testing::write_seven_scenes(folder.path(), true);
  core::Frame view;
  view.intrinsics = core::CameraIntrinsics::from_fov(testing::kWidth, testing::kHeight, 1.0);
  view.depth_m = core::Image<float>(testing::kWidth, testing::kHeight, 2.53125F);
  view.depth_m(3, 3) = std::nanf("");
  renderer::write_frame_exr(folder.path() / "frame-000000.depth.exr", view);
  const RgbdFrame frame = open_sequence(folder.path())->load(0);
  EXPECT_FLOAT_EQ(frame.depth_m(5, 5), 2.53125F);
  EXPECT_TRUE(std::isnan(frame.depth_m(3, 3)));
}

TEST(RgbdSequence, AcceptsFourNineAndSixteenIntrinsics) {
  for (const std::string text : {"20 21 7.5 5.5\n", "20 0 7.5\n0 21 5.5\n0 0 1\n",
                                 "20 0 7.5 0\n0 21 5.5 0\n0 0 1 0\n0 0 0 1\n"}) {
    const TemporaryFolder folder("intrinsics");
    testing::write_seven_scenes(folder.path(), true);
    testing::write_text(folder.path() / "intrinsics.txt", text);
    const auto sequence = open_sequence(folder.path());
    EXPECT_DOUBLE_EQ(sequence->intrinsics().fy_px, 21.0) << text;
    EXPECT_DOUBLE_EQ(sequence->intrinsics().cy_px, 5.5) << text;
  }
}

TEST(RgbdSequence, RefusesEightIntrinsics) {
  const TemporaryFolder folder("eight");
  testing::write_hololens(folder.path());
  testing::write_text(folder.path() / "K.txt", "20 0 7.5\n0 21 5.5\n0 0\n");
  EXPECT_THAT(open_error(folder.path()),
              AllOf(HasSubstr("K.txt"), HasSubstr("expected 9 numbers"),
                    HasSubstr("found 8 numbers")));
}

TEST(RgbdSequence, RefusesAnotherPoseCount) {
  const TemporaryFolder folder("count");
  testing::write_hololens(folder.path());
  testing::write_text(folder.path() / "poses.txt", testing::pose_line(1, 2, 3));
  EXPECT_THAT(open_error(folder.path()),
              AllOf(HasSubstr("poses.txt"), HasSubstr("3 poses"), HasSubstr("found 1 poses")));
}

/// A fault of one frame: refused with its place, or skipped with a warning that names the
/// frame.
struct FrameFault {
  const char* name;
  std::function<void(const std::filesystem::path&)> break_it;
  std::vector<std::string> message;
};

std::vector<FrameFault> frame_faults() {
  const auto second_pose = [](const std::string& line) {
    return [line](const std::filesystem::path& folder) {
      testing::write_text(folder / "poses.txt",
                          testing::pose_line(1, 2, 3) + line + testing::pose_line(3, 2, 3));
    };
  };
  return {
      {"nan pose",
       second_pose("1 0 0 nan 0 1 0 2 0 0 1 3 0 0 0 1\n"),
       {"poses.txt:2", "finite", "nan"}},
      {"short pose",
       second_pose("1 0 0 1 0 1 0 2 0 0 1 3\n"),
       {"poses.txt:2", "16", "found 12"}},
      {"scaled pose",
       second_pose("2 0 0 1 0 2 0 2 0 0 2 3 0 0 0 1\n"),
       {"poses.txt:2", "orthonormal", "off by 3"}},
      {"mirrored pose",
       second_pose("-1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1\n"),
       {"poses.txt:2", "determinant +1"}},
      {"truncated depth",
       [](const std::filesystem::path& folder) {
         testing::truncate_file(folder / "depth/00004.png", 0.6);
       },
       {"00004.png", "complete PNG"}},
      {"truncated colour",
       [](const std::filesystem::path& folder) {
         testing::truncate_file(folder / "rgb/00004.png", 0.6);
       },
       {"00004.png", "complete PNG"}},
      {"damaged depth",
       [](const std::filesystem::path& folder) {
         std::string bytes = core::read_file(folder / "depth/00004.png");
         bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 0x55);
         testing::write_text(folder / "depth/00004.png", bytes);
       },
       {"00004.png", "PNG"}},
      {"empty depth",
       [](const std::filesystem::path& folder) {
         testing::write_text(folder / "depth/00004.png", "");
       },
       {"00004.png", "empty file"}},
      {"small colour",
       [](const std::filesystem::path& folder) {
         cv::imwrite((folder / "rgb/00004.png").string(),
                     cv::Mat(6, 8, CV_8UC3, cv::Scalar(1)));
       },
       {"00004.png", "16x12", "found 8x6"}},
  };
}

TEST(RgbdSequence, RefusesOrSkipsBrokenFrames) {
  for (const FrameFault& fault : frame_faults()) {
    const TemporaryFolder folder("fault");
    testing::write_hololens(folder.path());
    fault.break_it(folder.path());
    const std::string message = open_error(folder.path(), with_floor(0.0));
    for (const std::string& part : fault.message) {
      EXPECT_THAT(message, HasSubstr(part)) << fault.name;
    }
    SequenceOptions skip = with_floor(0.0);
    skip.on_bad_frame = OnBadFrame::kSkip;
    const auto sequence = open_sequence(folder.path(), skip);
    ASSERT_EQ(sequence->frame_count(), 2U) << fault.name;
    EXPECT_EQ(sequence->frame_name(1), "00007") << fault.name;
    EXPECT_NEAR(sequence->pose(1).translation_m().x, 3.0, 1e-9) << fault.name;
    ASSERT_EQ(sequence->warnings().size(), 1U) << fault.name;
    EXPECT_THAT(sequence->warnings()[0], HasSubstr("00004")) << fault.name;
  }
}

TEST(RgbdSequence, RefusesTruncatedJpeg) {
  const TemporaryFolder folder("jpeg");
  testing::write_seven_scenes(folder.path(), false);
  std::filesystem::remove(folder.path() / "frame-000000.color.png");
  const auto file = folder.path() / "frame-000000.color.jpg";
  cv::imwrite(file.string(),
              cv::Mat(testing::kHeight, testing::kWidth, CV_8UC3, cv::Scalar(9)));
  EXPECT_EQ(open_error(folder.path(), with_floor(0.0)), "no error");
  testing::truncate_file(file, 0.8);
  EXPECT_THAT(open_error(folder.path(), with_floor(0.0)), HasSubstr("complete JPEG"));
}

TEST(RgbdSequence, RefusesMissingFilesAndUnknownLayouts) {
  const TemporaryFolder folder("missing");
  EXPECT_THAT(open_error(folder.path() / "no"), HasSubstr("no such folder"));
  EXPECT_THAT(open_error(folder.path()), AllOf(HasSubstr("hololens"), HasSubstr("7scenes")));
  testing::write_seven_scenes(folder.path(), true);
  std::filesystem::remove(folder.path() / "frame-000002.depth.png");
  EXPECT_THAT(open_error(folder.path()), HasSubstr("frame-000002.depth.png"));
}

TEST(RgbdSequence, RefusesIdsWithoutMeaning) {
  const TemporaryFolder folder("ids");
  testing::write_seven_scenes(folder.path(), true);
  cv::imwrite((folder.path() / "frame-000000.semantic.png").string(),
              cv::Mat(testing::kHeight, testing::kWidth, CV_16UC1, cv::Scalar(4)));
  const auto sequence = open_sequence(folder.path());
  EXPECT_THAT(input_error_of([&] { (void)sequence->load(0); }),
              AllOf(HasSubstr("semantic.png"), HasSubstr("found 4")));
}

TEST(RgbdSequence, LabelsFileIsStrict) {
  const std::string good =
      "schema: segsim.labels\nversion: 1\npixel_center: 0.5\nup: z\nclasses: []\n";
  for (const auto& [text, part] : std::vector<std::pair<std::string, std::string>>{
           {good + "colour: red\n", "colour"},
           {"schema: other\nversion: 1\npixel_center: 0.5\nup: z\n", "segsim.labels"},
           {"schema: segsim.labels\nversion: 2\npixel_center: 0.5\nup: z\n", "found 2"},
           {good + "instances:\n  - {id: 1, class: 8, name: a}\n", "class listed"},
           {"schema: segsim.labels\nversion: 1\npixel_center: 0.5\nup: z\nclasses:\n"
            "  - {id: 1, name: wall}\ninstances:\n  - {id: 1, class: 1, iscrowd: true}\n",
            "false for stuff"},
           {"schema: segsim.labels\nversion: 1\npixel_center: 0.5\nup: z\nclasses:\n"
            "  - {id: 1, name: a}\n  - {id: 1, name: b}\n",
            "not used above"}}) {
    const TemporaryFolder folder("labels");
    testing::write_seven_scenes(folder.path(), true);
    testing::write_text(folder.path() / "labels.yaml", text);
    EXPECT_THAT(open_error(folder.path()), AllOf(HasSubstr("labels.yaml"), HasSubstr(part)));
  }
}

TEST(RgbdSequence, LoadsFromManyThreads) {
  const TemporaryFolder folder("threads");
  testing::write_hololens(folder.path());
  const auto sequence = open_sequence(folder.path(), with_floor(0.0));
  std::vector<float> seen(4, 0.0F);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < seen.size(); ++t) {
    threads.emplace_back([&, t] { seen[t] = sequence->load(t % 3).depth_m(6, 6); });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_THAT(seen, ::testing::Each(1.006F));
}

TEST(RgbdSequence, CorrectsUnitsAndInvertedPosesOnRequest) {
  const TemporaryFolder folder("corrected");
  testing::write_seven_scenes(folder.path(), true);
  SequenceOptions options;
  options.depth_scale = 0.2;
  options.pose_scale = 0.001;
  options.invert_poses = true;
  const auto sequence = open_sequence(folder.path(), options);
  // The files say (1, 2, 3) without rotation.
  const glm::dvec3 position = sequence->pose(0).translation_m();
  EXPECT_NEAR(position.x, -0.001, 1e-12);
  EXPECT_NEAR(position.y, -0.002, 1e-12);
  EXPECT_NEAR(position.z, -0.003, 1e-12);
  EXPECT_FLOAT_EQ(sequence->load(0).depth_m(7, 5), 0.2F * 1.007F);
  EXPECT_THAT(sequence->notes(), ::testing::Contains("poses inverted"));
}

TEST(RgbdSequence, PositionsBeyondTenKilometresNameTheFlag) {
  const TemporaryFolder folder("far");
  testing::write_hololens(folder.path());
  testing::write_text(folder.path() / "poses.txt", testing::pose_line(12000.0, 2.0, 3.0) +
                                                       testing::pose_line(12001.0, 2.0, 3.0) +
                                                       testing::pose_line(12002.0, 2.0, 3.0));
  EXPECT_THAT(open_error(folder.path(), with_floor(0.0)),
              AllOf(HasSubstr("pose of frame 00003"), HasSubstr("--pose-scale 0.001")));
  SequenceOptions millimetres = with_floor(0.0);
  millimetres.pose_scale = 0.001;
  EXPECT_EQ(open_sequence(folder.path(), millimetres)->frame_count(), 3U);
}

TEST(FloorFit, FindsTheFloorBelowTableAndCeiling) {
  std::vector<glm::vec3> points;
  for (int i = 0; i < 40; ++i) {
    for (int j = 0; j < 40; ++j) {
      const float x = 0.1F * static_cast<float>(i), y = 0.1F * static_cast<float>(j);
      const float noise = 0.004F * static_cast<float>((i * 7 + j * 3) % 5 - 2);
      if ((i + j) % 3 == 0) points.emplace_back(x, y, -1.4F + noise);  // floor, partly seen
      points.emplace_back(x, y, 1.2F + noise);                // ceiling, the largest plane
      if (i < 12) points.emplace_back(x, y, -0.65F + noise);  // table
      points.emplace_back(0.0F, y, -1.4F + 0.065F * static_cast<float>(i));  // wall
    }
  }
  const auto floor_m = fit_floor_height_m(points);
  ASSERT_TRUE(floor_m.has_value());
  EXPECT_NEAR(*floor_m, -1.4, 0.01);
  EXPECT_FALSE(fit_floor_height_m(std::span(points).first(10)).has_value());
}

}  // namespace
}  // namespace segsim::reconstruction
