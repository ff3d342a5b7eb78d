// The bridge alone, with a renderer that draws nothing, beside a second process on the real
// transport. tests/system/gazebo/gazebo_test.cpp has the whole program.

#include "sim/gazebo/gazebo_bridge.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/error_message.h"
#include "tests/system/gazebo_processes.h"

namespace segsim::sim {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using tests::Process;

/// Sizes the images, takes its time, and fails when it was told to.
class BlankRenderer : public core::Renderer {
 public:
  using core::Renderer::render;
  void render(const core::CameraPose& /*T_world_camera*/,
              const core::CameraIntrinsics& intrinsics, core::Channels channels,
              core::Frame& frame) override {
    if (frames_left-- == 0) throw std::runtime_error("the device is gone");
    all_channels = all_channels | channels;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    frame.rgb.resize(intrinsics.width_px, intrinsics.height_px);
    frame.depth_m.resize(intrinsics.width_px, intrinsics.height_px);
    frame.semantic.resize(intrinsics.width_px, intrinsics.height_px);
    frame.instance.resize(intrinsics.width_px, intrinsics.height_px);
  }
  int frames_left = -1;  ///< Negative: never fails.
  core::Channels all_channels = core::Channels::kNone;
};

class Bridge : public ::testing::Test {
 protected:
  Bridge()
      : folder_(fs::temp_directory_path() / ("segsim_bridge_" + std::to_string(::getpid()))) {
    static int count = 0;
    partition_ = "segsim_bridge_" + std::to_string(::getpid()) + "_" + std::to_string(++count);
    ::setenv("IGN_PARTITION", partition_.c_str(), 1);
    ::setenv("IGN_IP", "127.0.0.1", 1);
    fs::create_directories(folder_);
    tests::record_drive(folder_ / "drive.txt", 40.0, 2.0);
    scene_.name = "test";
  }
  ~Bridge() override { fs::remove_all(folder_); }

  static GazeboCamera camera(double rate_hz) {
    GazeboCamera camera;
    camera.frame_id = "jackal::base_link::front";
    camera.link_path = {"jackal", "base_link"};
    camera.intrinsics = core::CameraIntrinsics::from_fov(64, 48, 1.2);
    camera.rate_hz = rate_hz;
    camera.near_m = 0.05;
    camera.far_m = 20.0;
    return camera;
  }

  std::unique_ptr<Process> peer(const std::vector<std::string>& extra) {
    std::vector<std::string> command = {SEGSIM_GAZEBO_PEER,
                                        "drive=" + (folder_ / "drive.txt").string(), "rate=40",
                                        "patience=60"};
    command.insert(command.end(), extra.begin(), extra.end());
    return std::make_unique<Process>(command, partition_, folder_ / "peer.txt");
  }

  GazeboBridgeOptions options_of(std::vector<GazeboCamera> cameras) const {
    GazeboBridgeOptions options;
    options.world = "tiny";
    options.cameras = std::move(cameras);
    return options;
  }

  fs::path folder_;
  std::string partition_;
  core::SceneManifest scene_;
};

TEST_F(Bridge, EveryPoseOfEveryViewIsAccountedFor) {
  GazeboCamera fast = camera(20.0), slow = camera(10.0), unseen = camera(5.0);
  fast.rgb_topic = "/fast/image";
  fast.info_topic = "/fast/camera_info";
  slow.labels_topic = "/slow/labels_map";
  unseen.depth_topic = "/unseen/depth_image";
  BlankRenderer renderer;
  GazeboBridge bridge(options_of({fast, slow, unseen}), renderer, scene_);
  EXPECT_EQ(bridge.pose_topic(), "/world/tiny/dynamic_pose/info");
  const auto driver = peer({"frames=80", "image=/fast/image", "image=/slow/labels_map",
                            "info=/fast/camera_info", "fault=nan", "fault_every=16"});
  bridge.run([&] { return driver->running(); });
  ASSERT_EQ(driver->wait(0.0), 0) << driver->output();
  const GazeboTraffic traffic = bridge.status().traffic;
  EXPECT_EQ(3 * traffic.poses, traffic.frames + traffic.early + traffic.repeated +
                                   traffic.superseded + traffic.unwatched + traffic.faults());
  EXPECT_EQ(traffic.faulty[static_cast<int>(PoseFault::kNotFinite)], 3U * 5U);
  EXPECT_GT(traffic.unwatched, 5U);
  EXPECT_GT(traffic.frames, 30U);
  EXPECT_GE(driver->value("complete"), 10);  // Times that both cameras share.
  // What nobody subscribed to is not drawn.
  EXPECT_FALSE(has(renderer.all_channels, core::Channels::kDepth));
  EXPECT_TRUE(has(renderer.all_channels, core::Channels::kRgb | core::Channels::kLabels));
}

TEST_F(Bridge, WhatTheRendererThrowsEndsIt) {
  GazeboCamera front = camera(0.0);
  front.rgb_topic = "/camera/image";
  BlankRenderer renderer;
  renderer.frames_left = 5;
  GazeboBridge bridge(options_of({front}), renderer, scene_);
  const auto driver = peer({"frames=100000", "image=/camera/image"});
  EXPECT_THROW(bridge.run([&] { return driver->running(); }), std::runtime_error);
  EXPECT_EQ(bridge.status().traffic.frames, 5U);
}

TEST_F(Bridge, TellsWhoseTopicsAreNotItsAlone) {
  GazeboCamera front = camera(10.0);
  front.rgb_topic = "/camera/image";
  front.depth_topic = "/camera/depth_image";
  BlankRenderer renderer;
  GazeboBridge bridge(options_of({front}), renderer, scene_);
  EXPECT_THAT(bridge.contested_topics(), ::testing::IsEmpty());
  const auto driver =
      peer({"frames=40", "image=/camera/image", "advertise=/camera/depth_image"});
  std::vector<std::string> contested;
  bridge.run([&] {
    if (contested.empty()) contested = bridge.contested_topics();
    return driver->running();
  });
  EXPECT_THAT(contested, ::testing::ElementsAre("/camera/depth_image"));
}

TEST_F(Bridge, StopsWhenToldThoughNothingComes) {
  GazeboCamera front = camera(30.0);
  front.rgb_topic = "/camera/image";
  BlankRenderer renderer;
  GazeboBridge bridge(options_of({front}), renderer, scene_);
  int asked = 0;
  bridge.run([&] { return ++asked < 4; });
  EXPECT_EQ(asked, 4);
  EXPECT_LT(bridge.status().since_pose_s, 0.0);
}

TEST_F(Bridge, BadOptionsAreOneLine) {
  BlankRenderer renderer;
  const auto error = [&](const GazeboBridgeOptions& options) {
    return tests::input_error_of([&] { GazeboBridge bridge(options, renderer, scene_); });
  };
  EXPECT_THAT(error(options_of({})), HasSubstr("expected at least one camera"));
  GazeboCamera front = camera(30.0);
  front.rgb_topic = "/camera/image";
  EXPECT_THAT(error(options_of({front, front})), HasSubstr("a topic name of its own"));
  front.rgb_topic = "/camera image";
  EXPECT_THAT(error(options_of({front})), HasSubstr("a topic name of its own"));
  front.rgb_topic = "/camera/image";
  GazeboBridgeOptions options = options_of({front});
  options.world = "not a name";
  EXPECT_THAT(error(options), HasSubstr("expected a valid name of a topic"));
}

}  // namespace
}  // namespace segsim::sim
