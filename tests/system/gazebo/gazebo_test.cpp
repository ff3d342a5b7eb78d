// `segsim gazebo serve` beside a second process on the real transport, well behaved and not.

#include <atomic>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/scene_bundle.h"
#include "experiments/scenes/scene_surfels.h"
#include "renderer/cpu_renderer.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/system/gazebo_processes.h"

namespace segsim {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using tests::number_after;
using tests::number_before;
using tests::Process;

constexpr const char* kTopicTool = "/usr/libexec/ignition/transport11/ign-transport-topic";
constexpr double kStartPatience_s = 120.0, kPeerPatience_s = 180.0;

class Gazebo : public ::testing::Test {
 protected:
  Gazebo() : folder_("gazebo_system"), bundle_(folder_.path() / "bundle") {
    static std::atomic<int> count{0};
    partition_ = "segsim_" + std::to_string(::getpid()) + "_" + std::to_string(++count);
    experiments::TinyScene().write(bundle_);
    tests::record_drive(folder_.path() / "drive.txt", 40.0, 4.0);
  }

  std::unique_ptr<Process> start(const std::vector<std::string>& command,
                                 const std::string& output) {
    return std::make_unique<Process>(command, partition_, folder_.path() / output);
  }

  /// A server that is ready.
  std::unique_ptr<Process> serve(const std::vector<std::string>& flags = {}) {
    std::vector<std::string> command = {SEGSIM_BINARY,    "gazebo",    "serve",
                                        bundle_.string(), "--backend", "cpu",
                                        "--hfov-deg",     "70"};
    command.insert(command.end(), flags.begin(), flags.end());
    auto server = start(command, "server.txt");
    EXPECT_TRUE(server->says("serving\n", kStartPatience_s)) << server->output();
    return server;
  }

  static std::vector<std::string> small() {
    return {"--width", "160", "--height", "120", "--rate", "20"};
  }

  /// A peer that subscribes to everything.
  std::unique_ptr<Process> peer(const std::vector<std::string>& extra,
                                const std::string& output = "peer.txt") {
    std::vector<std::string> command = {SEGSIM_GAZEBO_PEER,
                                        "drive=" + (folder_.path() / "drive.txt").string(),
                                        "rate=40",
                                        "image=/camera/image",
                                        "image=/camera/depth_image",
                                        "image=/panoptic/labels_map",
                                        "info=/camera/camera_info",
                                        "patience=60"};
    command.insert(command.end(), extra.begin(), extra.end());
    return start(command, output);
  }

  experiments::TemporaryFolder folder_;
  fs::path bundle_;
  std::string partition_;
};

std::string bytes_of(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

TEST_F(Gazebo, ARecordedDriveComesBackAsTheImagesOfItsPoses) {
  const auto server = serve(small());
  const auto driver = peer({"frames=80", "dump=" + folder_.path().string()});
  ASSERT_EQ(driver->wait(kPeerPatience_s), 0) << driver->output() << server->output();
  ASSERT_EQ(server->stop(), 0) << server->output();

  // 80 poses at 40 Hz are 40 frames at 20 Hz; what a busy machine did not draw was counted.
  const std::string report = server->output();
  EXPECT_GE(driver->value("complete"), 30);
  EXPECT_LE(driver->value("complete"), 40);
  const std::size_t counts = report.rfind("dropped: ");  // Status lines come before.
  const double superseded =
      counts == std::string::npos ? 0.0 : number_before(report.substr(counts), "superseded");
  EXPECT_GE(driver->value("complete") + superseded, 40) << report;
  EXPECT_EQ(driver->value("odd_sizes"), 0);
  EXPECT_EQ(driver->value("out_of_order"), 0);
  EXPECT_GT(driver->value("infos"), 0);
  EXPECT_EQ(driver->value("info_width"), 160);
  const auto camera = core::CameraIntrinsics::from_fov(160, 120, 70.0 * M_PI / 180.0);
  EXPECT_NEAR(driver->value("info_fx"), camera.fx_px, 1e-9);
  EXPECT_EQ(driver->value("info_cx"), 80.0);

  // The last frame, drawn here from the pose that was sent.
  int width = 0, height = 0, step = 0;
  std::int64_t stamp_ns = 0;
  std::string format, frame_id;
  std::ifstream(folder_.path() / "0.txt") >> width >> height >> step >> format >> stamp_ns >>
      frame_id;
  EXPECT_EQ(width, 160);
  EXPECT_EQ(height, 120);
  EXPECT_EQ(step, 480);
  EXPECT_EQ(format, "RGB_INT8");
  EXPECT_EQ(frame_id, "jackal::base_link::front");
  EXPECT_THAT(bytes_of(folder_.path() / "1.txt"), HasSubstr("160 120 640 R_FLOAT32"));
  EXPECT_THAT(bytes_of(folder_.path() / "2.txt"),
              AllOf(HasSubstr("RGB_INT8"), HasSubstr("jackal::base_link::front_labels")));
  const auto index = (stamp_ns - 1'000'000'000'000) / 25'000'000;
  ASSERT_GE(index, 0);
  std::ifstream drive(folder_.path() / "drive.txt");
  core::Pose2 place;
  for (std::int64_t i = 0; i <= index; ++i) drive >> place.x_m >> place.y_m >> place.yaw_rad;
  const auto T_world_camera = core::transform_from_pose2<core::frame::World>(place) *
                              core::mast_camera(1.0, 0.0);  // TinyScene's camera height
  const auto scene = experiments::scenes::load_scene_surfels(core::load_bundle(bundle_));
  const auto renderer = renderer::make_cpu_renderer(scene.surfels, {}, scene.labels);
  const core::Frame frame = renderer->render(
      T_world_camera, camera,
      core::Channels::kRgb | core::Channels::kDepth | core::Channels::kLabels);
  const std::string rgb = bytes_of(folder_.path() / "0.bin");
  const std::string depth = bytes_of(folder_.path() / "1.bin");
  const std::string labels = bytes_of(folder_.path() / "2.bin");
  ASSERT_EQ(rgb.size(), frame.rgb.size() * 3);
  ASSERT_EQ(depth.size(), frame.rgb.size() * 4);
  ASSERT_EQ(labels.size(), frame.rgb.size() * 3);
  // The pose went through another composition of transforms: rounding may move an edge.
  std::size_t rgb_differs = 0, depth_differs = 0, labels_differ = 0, seen = 0;
  for (std::size_t i = 0; i < frame.rgb.size(); ++i) {
    const core::Rgb8 color = frame.rgb.pixels()[i];
    const auto at = [&](const std::string& bytes, std::size_t k) {
      return static_cast<int>(static_cast<unsigned char>(bytes[3 * i + k]));
    };
    rgb_differs += std::abs(at(rgb, 0) - color.r) > 1 || std::abs(at(rgb, 1) - color.g) > 1 ||
                   std::abs(at(rgb, 2) - color.b) > 1;
    float depth_m = 0.0F;
    std::memcpy(&depth_m, depth.data() + 4 * i, sizeof depth_m);
    const float truth_m = frame.depth_m.pixels()[i];
    depth_differs += std::isnan(truth_m) ? depth_m != std::numeric_limits<float>::infinity()
                                         : std::abs(depth_m - truth_m) > 1e-3F;
    const int label = frame.semantic.pixels()[i];
    // One chair, one couch, stuff: each is the first of its class.
    labels_differ +=
        at(labels, 2) != label || at(labels, 0) != (label == 0 ? 0 : 1) || at(labels, 1) != 0;
    seen += label != 0 ? 1 : 0;
  }
  EXPECT_GT(seen, frame.rgb.size() / 2);
  EXPECT_LE(rgb_differs, frame.rgb.size() / 200);
  EXPECT_LE(depth_differs, frame.rgb.size() / 200);
  EXPECT_LE(labels_differ, frame.rgb.size() / 200);
}

TEST_F(Gazebo, ServesTheCamerasOfAnExportedWorldToLaterGazebos) {
  const std::string out = (folder_.path() / "world").string();
  const auto exported =
      start({SEGSIM_BINARY, "gazebo", "export-world", bundle_.string(), "-o", out, "--width",
             "96", "--height", "64", "--rate", "20", "--flavour", "gz"},
            "export.txt");
  ASSERT_EQ(exported->wait(kStartPatience_s), 0) << exported->output();
  EXPECT_THAT(exported->output(), HasSubstr("gz sim -r " + out + "/world.sdf"));
  const auto server = serve({"--world", out + "/world.sdf"});
  EXPECT_THAT(server->output(), HasSubstr("jackal::base_link::front: 96 x 64, 20 Hz"));
  const auto driver = peer({"frames=20", "prefix=gz.msgs."});
  EXPECT_EQ(driver->wait(kPeerPatience_s), 0) << driver->output() << server->output();
  EXPECT_GE(driver->value("complete"), 5);
  EXPECT_EQ(driver->value("info_width"), 96);
  EXPECT_EQ(server->stop(SIGTERM), 0);
}

TEST_F(Gazebo, MalformedPosesAreCountedAndTheNextGoodOneIsServed) {
  const auto server = serve(small());
  for (const char* fault : {"nan", "quaternion", "entity", "stamp", "garbage"}) {
    const auto driver = peer({"frames=40", "fault_every=4", std::string("fault=") + fault});
    ASSERT_EQ(driver->wait(kPeerPatience_s), 0) << fault << driver->output();
    EXPECT_GE(driver->value("complete"), 10) << fault;
  }
  ASSERT_EQ(server->stop(), 0);
  const std::string report = server->output();
  const std::string dropped = report.substr(report.rfind("dropped: "));
  EXPECT_EQ(number_before(dropped, "poses not finite"), 10) << dropped;
  EXPECT_EQ(number_before(dropped, "poses no unit quaternion"), 10) << dropped;
  EXPECT_EQ(number_before(dropped, "poses without the camera's link"), 10) << dropped;
  EXPECT_EQ(number_before(dropped, "poses without time"), 10) << dropped;
  EXPECT_EQ(number_before(dropped, "poses unreadable"), 10) << dropped;
  // Each new peer began its time anew.
  EXPECT_EQ(number_before(dropped, "times"), 4) << dropped;
}

TEST_F(Gazebo, SurvivesTheDeathOfItsPeerAndServesTheNext) {
  const auto server = serve(small());
  {
    const auto victim = peer({"frames=100000"}, "victim.txt");
    std::this_thread::sleep_for(std::chrono::seconds(2));
    ASSERT_TRUE(victim->running());
    EXPECT_EQ(victim->stop(SIGKILL), 128 + SIGKILL);
  }
  ASSERT_TRUE(server->running());
  const auto driver = peer({"frames=40"});
  ASSERT_EQ(driver->wait(kPeerPatience_s), 0) << driver->output();
  EXPECT_GE(driver->value("complete"), 10);
  EXPECT_EQ(server->stop(), 0);
}

TEST_F(Gazebo, AFloodIsDroppedWithinBoundedMemory) {
  const auto server = serve({"--rate", "1000"});  // 640 x 480: more than it can draw.
  const auto warm = peer({"frames=40"});
  ASSERT_EQ(warm->wait(kPeerPatience_s), 0) << warm->output();
  const double before_mb = server->resident_mb();
  const auto flood = peer({"frames=5000", "rate=1000"});
  double most_mb = before_mb;
  while (flood->running()) {
    most_mb = std::max(most_mb, server->resident_mb());
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  EXPECT_EQ(flood->wait(0.0), 0) << flood->output();
  EXPECT_LT(most_mb - before_mb, 100.0);
  // Recovers: a gentle peer is served as before.
  const auto driver = peer({"frames=40"}, "gentle.txt");
  ASSERT_EQ(driver->wait(kPeerPatience_s), 0) << driver->output();
  EXPECT_GE(driver->value("complete"), 5);
  ASSERT_EQ(server->stop(), 0);
  const std::string report = server->output();
  EXPECT_GE(number_before(report.substr(report.rfind("served ")), "poses,"), 5000) << report;
  EXPECT_GT(number_before(report.substr(report.rfind("dropped: ")), "superseded"), 1000)
      << report;
}

TEST_F(Gazebo, ASubscriberThatStopsReadingCostsBoundedMemory) {
  const auto server = serve({"--rate", "20"});  // 640 x 480: 3 MB a frame.
  const auto stuck = peer({"frames=100000"}, "stuck.txt");
  std::this_thread::sleep_for(std::chrono::seconds(3));
  ASSERT_TRUE(stuck->running()) << stuck->output();
  stuck->send(SIGSTOP);
  const double before_mb = server->resident_mb();
  const auto driver = peer({"frames=400"});  // 10 s: 600 MB would pile up.
  ASSERT_EQ(driver->wait(kPeerPatience_s), 0) << driver->output();
  EXPECT_GE(driver->value("complete"), 20);
  EXPECT_LT(server->resident_mb() - before_mb, 150.0);
  EXPECT_EQ(server->stop(), 0);
}

TEST_F(Gazebo, GazebosOwnToolSeesItsTopics) {
  if (!fs::exists(kTopicTool)) GTEST_SKIP() << "ignition-transport-cli";
  const auto server = serve(small());
  const auto list = [&] {
    const auto tool = start({kTopicTool, "-l"}, "list.txt");
    EXPECT_EQ(tool->wait(60.0), 0);
    return tool->output();
  };
  std::string topics;
  for (int i = 0; i < 10 && topics.find("/panoptic/colored_map") == std::string::npos; ++i) {
    topics = list();
  }
  for (const char* topic :
       {"/camera/image\n", "/camera/depth_image\n", "/camera/camera_info\n",
        "/panoptic/labels_map\n", "/panoptic/colored_map\n", "/panoptic/camera_info\n"}) {
    EXPECT_THAT(topics, HasSubstr(topic));
  }
  const auto echo =
      start({kTopicTool, "-e", "-n", "1", "-t", "/camera/camera_info"}, "echo.txt");
  const auto driver = peer({"frames=400"});
  EXPECT_EQ(echo->wait(kPeerPatience_s), 0);
  EXPECT_THAT(echo->output(), AllOf(HasSubstr("width: 160"), HasSubstr("intrinsics {"),
                                    HasSubstr("jackal::base_link::front")));
  EXPECT_EQ(server->stop(), 0);
}

TEST_F(Gazebo, DrawsNothingThatNobodySubscribedTo) {
  const auto server = serve(small());
  std::vector<std::string> command = {SEGSIM_GAZEBO_PEER,
                                      "drive=" + (folder_.path() / "drive.txt").string(),
                                      "rate=40", "frames=40"};
  const auto driver = start(command, "peer.txt");
  ASSERT_EQ(driver->wait(kPeerPatience_s), 0) << driver->output();
  ASSERT_EQ(server->stop(), 0);
  const std::string report = server->output();
  EXPECT_THAT(report, HasSubstr(" 0 frames, 0 messages"));
  EXPECT_GT(number_before(report, "unwatched"), 5) << report;
}

TEST_F(Gazebo, ExitCodesTellWhatHappened) {
  const auto exit_of = [&](std::vector<std::string> arguments, const std::string& message) {
    arguments.insert(arguments.begin(), {SEGSIM_BINARY, "gazebo", "serve"});
    const auto process = start(arguments, "bad.txt");
    const int code = process->wait(kStartPatience_s);
    EXPECT_THAT(process->output(), HasSubstr(message));
    return code;
  };
  EXPECT_EQ(exit_of({(folder_.path() / "none").string()}, "scene.yaml"), 2);
  EXPECT_EQ(exit_of({bundle_.string(), "--world", "/nowhere.sdf"}, "no such file"), 2);
  EXPECT_EQ(exit_of({bundle_.string(), "--backend", "cpu", "--pose-topic", "no topic"},
                    "expected a valid name of a topic"),
            2);
  EXPECT_EQ(exit_of({bundle_.string(), "--flavour", "classic"}, "flavour"), 2);
  // A time limit is a clean end; faulty poses are a loss for those who asked.
  EXPECT_EQ(
      exit_of({bundle_.string(), "--backend", "cpu", "--duration", "0.5"}, "dropped: nothing"),
      0);
  const auto server = serve({"--width", "64", "--height", "48", "--expect-no-loss"});
  const auto driver = peer({"frames=10", "fault=nan", "fault_every=5"});
  EXPECT_EQ(driver->wait(kPeerPatience_s), 0);
  EXPECT_EQ(server->stop(), 1);
  EXPECT_THAT(server->output(), HasSubstr("expected no loss, found"));
}

}  // namespace
}  // namespace segsim
