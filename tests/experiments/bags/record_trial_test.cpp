// A trial through the whole chain: run, played again into an MCAP file, read.
#include "experiments/bags/record_trial.h"

#include <cmath>
#include <map>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "experiments/bags/unpack_recording.h"
#include "experiments/records/replay_log.h"
#include "experiments/runs/run.h"
#include "ros/mcap/topic.h"
#include "ros/messages/all_messages.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"

namespace segsim::experiments::bags {
namespace {

namespace fs = std::filesystem;
using ros::mcap::StoredMessage;

/// The robot does not know where it is to the centimetre, and has every sensor.
const std::string kSpec = TinySpec{.name = "bag",
                                   .arms = "  - {name: after, detector: oracle}\n",
                                   .time_limit_s = 20.0,
                                   .more = R"(sensors: {lidar: {}, imu: {}, gps: {}}
localisation: noisy
success: {profile: segsim-object, distance_m: 1.0, visible_pixels: 30}
pictures: false
replays: {of: all}
)"}
                              .text();

class RecordTrial : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("record_trial");
    TinyScene().write(folder_->path() / "tiny");
    runs::RunOptions options;
    options.folders = folders();
    (void)runs::run_experiment(specs::parse_spec(kSpec, "bag.yaml", options.folders), options);
    (void)record_trial(log_file(), folders(), bag_file(), ros::mcap::Compression::kLz4);
  }
  static void TearDownTestSuite() { delete folder_; }

  static specs::SpecFolders folders() { return {folder_->path(), folder_->path() / "work"}; }
  static fs::path log_file() {
    return folder_->path() / "work/replays/tiny/couch-00.after.jsonl";
  }
  static fs::path bag_file() { return folder_->path() / "trial.mcap"; }

  template <class M>
  static std::vector<M> messages(const std::string& topic) {
    ros::mcap::Reader reader(bag_file());
    std::vector<M> found;
    const std::vector<std::string> topics = {topic};
    reader.read([&](const StoredMessage& m) { found.push_back(ros::mcap::decode<M>(m)); },
                topics);
    return found;
  }

  static TemporaryFolder* folder_;
};
TemporaryFolder* RecordTrial::folder_ = nullptr;

TEST_F(RecordTrial, HasTheTopicsOfARobotAndNoneOfTheTruth) {
  ros::mcap::Reader reader(bag_file());
  std::map<std::string, int> counts;
  std::uint64_t last_ns = 0;
  reader.read([&](const StoredMessage& message) {
    ++counts[message.channel->topic];
    EXPECT_GE(message.log_time_ns, last_ns);
    last_ns = message.log_time_ns;
  });
  const records::ReplayLog log = records::read_replay_log(log_file());
  const int images = static_cast<int>(log.detections.size());
  const int ticks = static_cast<int>(log.ticks.size());
  ASSERT_GT(images, 5);
  EXPECT_EQ(counts, (std::map<std::string, int>{{"/camera/camera_info", images},
                                                {"/camera/depth/image_raw", images},
                                                {"/camera/image_raw", images},
                                                {"/clock", ticks},
                                                {"/cmd_vel", ticks},
                                                {"/detections", images},
                                                {"/gps/fix", counts["/gps/fix"]},
                                                {"/imu", counts["/imu"]},
                                                {"/odom", ticks},
                                                {"/scan", counts["/scan"]},
                                                {"/tf", counts["/tf"]},
                                                {"/tf_static", 1}}));
  for (const char* topic : {"/gps/fix", "/imu", "/scan"})
    EXPECT_GT(counts[topic], 10) << topic;
  EXPECT_EQ(reader.metadata().at(0).values.at("outcome"), sim::to_string(log.outcome));
}

TEST_F(RecordTrial, OdometryIsWhatTheRobotBelieves) {
  const records::ReplayLog log = records::read_replay_log(log_file());
  const auto odometry = messages<ros::nav_msgs::Odometry>("/odom");
  const auto commands = messages<ros::geometry_msgs::Twist>("/cmd_vel");
  ASSERT_EQ(odometry.size(), log.ticks.size());
  // The localiser is some centimetres off.
  double error_m = 0.0;
  for (std::size_t k = 0; k < odometry.size(); ++k) {
    const sim::TickRecord& tick = log.ticks[k];
    const auto& position = odometry[k].pose.pose.position;
    const double off_m = std::hypot(position.x - tick.pose.x_m, position.y - tick.pose.y_m);
    EXPECT_LT(off_m, 0.5);
    error_m += off_m;
    EXPECT_EQ(commands[k].linear.x, tick.command.forward_mps);
  }
  EXPECT_GT(error_m, 0.01) << "the true pose must not be in the file";
}

TEST_F(RecordTrial, DetectionsAreThoseOfTheLog) {
  const records::ReplayLog log = records::read_replay_log(log_file());
  const auto arrays = messages<ros::vision_msgs::Detection2DArray>("/detections");
  std::size_t image = 0;
  for (const auto& [index, detections] : log.detections) {
    const auto& array = arrays.at(image++);
    ASSERT_EQ(array.detections.size(), detections.size());
    for (std::size_t k = 0; k < detections.size(); ++k) {
      EXPECT_EQ(array.detections[k].bbox.size_x, detections[k].box.width_px());
      EXPECT_EQ(array.detections[k].results.at(0).hypothesis.class_id,
                log.class_names.at(static_cast<std::size_t>(detections[k].class_index)));
    }
  }
}

TEST_F(RecordTrial, ImagesHaveCameraInfoAndTransformsOfTheirTime) {
  const auto colour = messages<ros::sensor_msgs::Image>("/camera/image_raw");
  const auto depth = messages<ros::sensor_msgs::Image>("/camera/depth/image_raw");
  const auto info = messages<ros::sensor_msgs::CameraInfo>("/camera/camera_info");
  std::map<std::pair<int, unsigned>, ros::geometry_msgs::Transform> poses;
  for (const auto& tf : messages<ros::tf2_msgs::TFMessage>("/tf")) {
    const auto& one = tf.transforms.at(0);
    EXPECT_EQ(one.header.frame_id + " " + one.child_frame_id, "odom base_link");
    const std::pair time{one.header.stamp.sec, one.header.stamp.nanosec};
    EXPECT_TRUE(poses.emplace(time, one.transform).second) << "two poses of one time";
  }
  for (std::size_t k = 0; k < colour.size(); ++k) {
    EXPECT_EQ(colour[k].header, depth[k].header);
    EXPECT_EQ(colour[k].header, info[k].header);
    EXPECT_EQ(colour[k].data.size(), 96U * 72 * 3);
    EXPECT_EQ(depth[k].data.size(), 96U * 72 * 4);
    EXPECT_TRUE(poses.contains({info[k].header.stamp.sec, info[k].header.stamp.nanosec}));
  }
  EXPECT_EQ(info[0].k[2], 47.5);
  EXPECT_NE(colour.front().data, colour.back().data);

  const auto mounts = messages<ros::tf2_msgs::TFMessage>("/tf_static").at(0).transforms;
  std::vector<std::string> frames;
  for (const auto& mount : mounts) frames.push_back(mount.child_frame_id);
  EXPECT_THAT(frames, testing::ElementsAre("camera_optical_frame", "laser", "gps"));
  EXPECT_NEAR(mounts[0].transform.translation.z, 1.0, 1e-12);
}

TEST_F(RecordTrial, CanBeReconstructedFrom) {
  const UnpackSummary summary = unpack_recording(bag_file(), folder_->path() / "unpacked", {});
  const records::ReplayLog log = records::read_replay_log(log_file());
  EXPECT_EQ(summary.color_images, log.detections.size());
  EXPECT_EQ(summary.depth_images, log.detections.size());
  EXPECT_EQ(summary.without_pose, 0U);
  EXPECT_EQ(summary.camera_frame + " in " + summary.fixed_frame,
            "camera_optical_frame in odom");
}

TEST_F(RecordTrial, TwoRecordingsAreTheSameBytes) {
  const fs::path again = folder_->path() / "again.mcap";
  (void)record_trial(log_file(), folders(), again, ros::mcap::Compression::kLz4);
  EXPECT_EQ(core::sha256_of_file(again), core::sha256_of_file(bag_file()));
}

TEST_F(RecordTrial, ATrialThatWouldBeAnotherIsNotWritten) {
  records::ReplayLog log = records::read_replay_log(log_file());
  log.ticks.at(3).command.forward_mps += 0.1;
  const fs::path changed = log_file().parent_path() / "changed.jsonl";
  records::write_replay_log(changed, log);
  const fs::path output = folder_->path() / "changed.mcap";
  EXPECT_THAT(tests::input_error_of([&] {
                (void)record_trial(changed, folders(), output, ros::mcap::Compression::kNone);
              }),
              testing::HasSubstr("expected the same trial when it is played again"));
  EXPECT_FALSE(fs::exists(output));
}

}  // namespace
}  // namespace segsim::experiments::bags
