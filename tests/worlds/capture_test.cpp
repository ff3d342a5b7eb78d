#include "worlds/capture/capture.h"

#include <cmath>
#include <fstream>
#include <sstream>

#include <ImfArray.h>
#include <ImfFrameBuffer.h>
#include <ImfInputFile.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <glm/gtc/quaternion.hpp>
#include <opencv2/imgcodecs.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "tests/worlds/mesh_fixtures.h"

namespace segsim::worlds {
namespace {

using ::testing::HasSubstr;

/// Pixels that say where they are, with one hole and one far pixel; counts its calls.
class PatternRenderer final : public core::Renderer {
 public:
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              core::Channels, core::Frame& frame) override {
    ++calls;
    frame.T_world_camera = T_world_camera;
    frame.intrinsics = intrinsics;
    frame.rgb.resize(4, 3);
    frame.depth_m.resize(4, 3);
    frame.semantic.resize(4, 3);
    frame.instance.resize(4, 3);
    for (int y = 0; y < 3; ++y) {
      for (int x = 0; x < 4; ++x) {
        frame.rgb(x, y) = {static_cast<std::uint8_t>(10 * x),
                           static_cast<std::uint8_t>(20 * y), 200};
        frame.depth_m(x, y) = 1.2344F + 0.5F * static_cast<float>(x);
        frame.semantic(x, y) = static_cast<std::uint16_t>(x);
        frame.instance(x, y) = static_cast<std::uint16_t>(1000 * y);
      }
    }
    frame.depth_m(0, 0) = std::nanf("");
    frame.depth_m(1, 0) = 50.0F;
  }
  int calls = 0;
};

class Capture : public ::testing::Test {
 protected:
  CaptureReport run(const CaptureOptions& options = {}) {
    return capture_sequence(renderer_, poses_, camera_, folder_.path() / "out", classes_,
                            instances_, options);
  }
  [[nodiscard]] std::filesystem::path file(const std::string& name) const {
    return folder_.path() / "out" / name;
  }

  TemporaryFolder folder_;
  PatternRenderer renderer_;
  core::CameraIntrinsics camera_ = core::CameraIntrinsics::from_fov(4, 3, 1.2);
  std::vector<core::CameraPose> poses_{core::look_at({0, 0, 1}, {1, 0.5, 0.8}),
                                       core::look_at({2, 1, 1.5}, {0, 0, 1})};
  std::vector<core::SceneClass> classes_{{1, "wall", false}, {2, "chair", true}};
  std::vector<core::SceneInstance> instances_ = box_room().instances;
};

TEST_F(Capture, WritesWhatTheRendererGave) {
  CaptureOptions options;
  options.depth_exr = true;
  const CaptureReport report = run(options);
  EXPECT_EQ(report.written, 2);
  const cv::Mat colour =
      cv::imread(file("frame-000001.color.png").string(), cv::IMREAD_UNCHANGED);
  const cv::Mat depth =
      cv::imread(file("frame-000001.depth.png").string(), cv::IMREAD_UNCHANGED);
  const cv::Mat semantic =
      cv::imread(file("frame-000001.semantic.png").string(), cv::IMREAD_UNCHANGED);
  const cv::Mat instance =
      cv::imread(file("frame-000001.instance.png").string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(depth.type(), CV_16UC1);
  ASSERT_EQ(semantic.type(), CV_16UC1);
  ASSERT_EQ(colour.size(), cv::Size(4, 3));
  EXPECT_EQ(colour.at<cv::Vec3b>(2, 3), cv::Vec3b(200, 40, 30)) << "OpenCV's order is b, g, r";
  EXPECT_EQ(depth.at<std::uint16_t>(0, 0), 0) << "a hole";
  EXPECT_EQ(depth.at<std::uint16_t>(0, 1), 0) << "out of range";
  EXPECT_EQ(depth.at<std::uint16_t>(2, 2), 2234) << "2.2344 m";
  EXPECT_EQ(semantic.at<std::uint16_t>(1, 3), 3);
  EXPECT_EQ(instance.at<std::uint16_t>(2, 0), 2000);

  Imf::InputFile exr(file("frame-000001.depth.exr").string().c_str());
  Imf::Array2D<float> z(3, 4);
  Imf::FrameBuffer buffer;
  buffer.insert("Z", Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(&z[0][0]), sizeof(float),
                                4 * sizeof(float)));
  exr.setFrameBuffer(buffer);
  exr.readPixels(0, 2);
  EXPECT_EQ(z[2][2], 2.2344F);
  EXPECT_TRUE(std::isnan(z[0][0]));
}

TEST_F(Capture, PosesIntrinsicsAndLabelsRoundTrip) {
  CaptureOptions options;
  options.source = "a \"test\"";
  run(options);
  std::istringstream pose(core::read_file(file("frame-000000.pose.txt")));
  const glm::dmat3 R = glm::mat3_cast(poses_[0].rotation());
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) {
      double value = 0;
      pose >> value;
      EXPECT_DOUBLE_EQ(value, column < 3 ? R[column][row] : poses_[0].translation_m()[row]);
    }
  }
  double last = 0;
  for (int i = 0; i < 4; ++i) pose >> last;
  EXPECT_EQ(last, 1.0);
  std::istringstream intrinsics(core::read_file(file("intrinsics.txt")));
  double fx = 0;
  double zero = 1;
  double cx = 0;
  intrinsics >> fx >> zero >> cx;
  EXPECT_DOUBLE_EQ(fx, camera_.fx_px);
  EXPECT_EQ(zero, 0.0);
  EXPECT_DOUBLE_EQ(cx, 2.0) << "the centre of four pixels with pixel centres at +0.5";
  const std::string labels = core::read_file(file("labels.yaml"));
  EXPECT_THAT(labels,
              HasSubstr("schema: segsim.labels\nversion: 1\npixel_center: 0.5\nup: z\n"));
  EXPECT_THAT(labels, HasSubstr("source: \"a \\\"test\\\"\""));
  EXPECT_THAT(labels, HasSubstr("  - {id: 2, name: \"chair\", thing: true}\n"));
  EXPECT_THAT(labels, HasSubstr("  - {id: 1, class: 4, name: \"chair \\\"one\\\"\"}\n"));
}

TEST_F(Capture, ResumesWhereItWasInterrupted) {
  run();
  EXPECT_EQ(renderer_.calls, 2);
  EXPECT_EQ(run().kept, 2);
  EXPECT_EQ(renderer_.calls, 2) << "complete frames are not rendered again";
  std::filesystem::remove(file("frame-000001.pose.txt"));
  const CaptureReport report = run();
  EXPECT_EQ(report.kept, 1);
  EXPECT_EQ(report.written, 1);
  EXPECT_TRUE(std::filesystem::exists(file("frame-000001.pose.txt")));
}

TEST_F(Capture, AnotherCaptureIsRefusedOrOverwritten) {
  run();
  poses_.pop_back();
  EXPECT_THROW(run(), core::InputError);
  CaptureOptions options;
  options.overwrite = true;
  EXPECT_EQ(run(options).written, 1);
  EXPECT_FALSE(std::filesystem::exists(file("frame-000001.color.png"))) << "left from before";
}

TEST_F(Capture, FramesOfUnknownOriginAreNotTouched) {
  folder_.write("out/frame-000000.color.png", "someone's");
  EXPECT_THROW(run(), core::InputError);
  EXPECT_EQ(core::read_file(file("frame-000000.color.png")), "someone's");
}

TEST_F(Capture, ReportsEveryFrame) {
  std::vector<int> done;
  CaptureOptions options;
  options.on_frame = [&](int frames, int total) {
    EXPECT_EQ(total, 2);
    done.push_back(frames);
  };
  run(options);
  EXPECT_EQ(done, (std::vector<int>{1, 2}));
}

}  // namespace
}  // namespace segsim::worlds
