#include "experiments/bags/unpack_recording.h"

#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <opencv2/imgcodecs.hpp>

#include "core/file_io.h"
#include "experiments/ros2/ros_messages.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "ros/mcap/topic.h"
#include "ros/messages/tf2_msgs.h"
#include "tests/error_message.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments::bags {
namespace {

namespace fs = std::filesystem;
using ros::mcap::TopicWriter;
using ros::sensor_msgs::Image;
using testing::HasSubstr;

constexpr int kWidth_px = 40, kHeight_px = 30;
constexpr core::CameraIntrinsics kCamera{kWidth_px, kHeight_px, 30.0, 31.0, 20.5, 15.25};
constexpr core::TimeNs kPeriod_ns = 100'000'000;

/// What a robot with other habits recorded.
struct Recording {
  int images = 6;
  core::TimeNs epoch_ns = 1'700'000'000'123'456'789;
  /// Transforms come in between images.
  core::TimeNs tf_shift_ns = 30'000'000;
  std::string depth_frame = "cam", color_topic = "/camera/image_raw";
  bool depth_in_mm = false, compressed = false, with_tf = true;
  std::vector<double> distortion = {0.0, 0.0, 0.0, 0.0, 0.0};

  /// 0.2 m/s along x, turning.
  static core::Pose2 pose(double time_s) { return {0.2 * time_s, 0.0, 0.5 * time_s}; }
  static float depth_m(int x) { return 1.0F + 0.05F * static_cast<float>(x); }

  void write(const fs::path& file) const {
    std::ofstream out(file, std::ios::binary);
    ros::mcap::Writer writer(out);
    TopicWriter<ros::tf2_msgs::TFMessage> tf(writer, "/tf"), tf_static(writer, "/tf_static");
    TopicWriter<ros::sensor_msgs::CameraInfo> info(writer, "/camera/camera_info");
    TopicWriter<Image> color(writer, compressed ? "/unused" : color_topic);
    TopicWriter<ros::sensor_msgs::CompressedImage> jpeg(writer,
                                                        compressed ? color_topic : "/unused2");
    TopicWriter<Image> depth(writer, "/camera/depth/image_raw");
    const auto at = [](core::TimeNs time_ns) { return static_cast<std::uint64_t>(time_ns); };
    if (with_tf) {
      tf_static.write(
          at(epoch_ns),
          {{ros2::ros_transform_stamped(epoch_ns, "base", "cam",
                                        ros2::ros_transform(core::mast_camera(1.0, 0.1)))}});
    }
    for (int k = 0; k < images; ++k) {
      const core::TimeNs time_ns = epoch_ns + k * kPeriod_ns;
      if (with_tf) {
        const core::TimeNs tf_ns = time_ns - tf_shift_ns;
        const auto T_odom_base = core::transform_from_pose2<core::frame::Odom>(
            pose(core::seconds(tf_ns - epoch_ns)));
        tf.write(at(tf_ns), {{ros2::ros_transform_stamped(tf_ns, "odom", "base",
                                                          ros2::ros_transform(T_odom_base))}});
      }
      auto calibration = ros2::ros_camera_info(kCamera, ros2::ros_header(time_ns, "cam"));
      calibration.d = distortion;
      info.write(at(time_ns), calibration);
      write_color(k, time_ns, color, jpeg);
      depth.write(at(time_ns), depth_image(time_ns));
    }
    writer.close();
  }

  void write_color(int k, core::TimeNs time_ns, TopicWriter<Image>& raw,
                   TopicWriter<ros::sensor_msgs::CompressedImage>& packed) const {
    core::Image<core::Rgb8> picture(kWidth_px, kHeight_px,
                                    {static_cast<std::uint8_t>(20 * k), 90, 30});
    const ros::std_msgs::Header header = ros2::ros_header(time_ns, "cam");
    if (!compressed) {
      Image message;
      message.header = header;
      ros2::to_ros(picture, message);
      raw.write(static_cast<std::uint64_t>(time_ns), message);
      return;
    }
    const cv::Mat bgr(kHeight_px, kWidth_px, CV_8UC3, cv::Scalar(30, 90, 20 * k));
    ros::sensor_msgs::CompressedImage message{header, "rgb8; png compressed bgr8", {}};
    cv::imencode(".png", bgr, message.data);
    packed.write(static_cast<std::uint64_t>(time_ns), message);
  }

  [[nodiscard]] Image depth_image(core::TimeNs time_ns) const {
    Image message;
    core::Image<float> metres(kWidth_px, kHeight_px);
    for (int y = 0; y < kHeight_px; ++y) {
      for (int x = 0; x < kWidth_px; ++x) metres(x, y) = depth_m(x);
    }
    metres(0, 0) = std::numeric_limits<float>::quiet_NaN();
    ros2::to_ros(metres, message);
    message.header = ros2::ros_header(time_ns + 3'000'000, depth_frame);
    if (!depth_in_mm) return message;
    message.encoding = "16UC1";
    message.step = kWidth_px * 2;
    message.data.clear();
    for (const float value_m : metres.pixels()) {
      const auto mm =
          std::isnan(value_m) ? 0U : static_cast<unsigned>(std::lround(1e3F * value_m));
      message.data.push_back(static_cast<std::uint8_t>(mm & 255U));
      message.data.push_back(static_cast<std::uint8_t>(mm >> 8U));
    }
    return message;
  }
};

class UnpackRecording : public testing::Test {
 protected:
  UnpackSummary unpack(const Recording& recording, const UnpackOptions& options = {}) {
    recording.write(folder_ / "a.mcap");
    return unpack_recording(folder_ / "a.mcap", folder_ / "unpacked", options);
  }
  std::string error(const Recording& recording, const UnpackOptions& options = {}) {
    return tests::input_error_of([&] { (void)unpack(recording, options); });
  }
  std::unique_ptr<reconstruction::RgbdSequence> open() {
    reconstruction::SequenceOptions options;
    options.layout = reconstruction::SequenceLayout::kTum;
    options.up_axis = reconstruction::UpAxis::kZ;
    options.floor_height_m = 0.0;
    return reconstruction::open_sequence(folder_ / "unpacked", options);
  }
  tests::TemporaryFolder folder_;
};

TEST_F(UnpackRecording, FramesHaveTheirPicturesDepthAndInterpolatedPoses) {
  for (const bool in_mm : {false, true}) {
    for (const bool compressed : {false, true}) {
      const UnpackSummary summary = unpack({.depth_in_mm = in_mm, .compressed = compressed});
      // The last image is later than the last transform.
      EXPECT_EQ(summary.color_images, 5U);
      EXPECT_EQ(summary.without_pose, 1U);
      EXPECT_EQ(summary.depth_images, 6U);
      EXPECT_EQ(summary.fixed_frame, "odom");
      EXPECT_EQ(summary.truncation, "");
      const auto sequence = open();
      ASSERT_EQ(sequence->frame_count(), 5U);
      EXPECT_NEAR(sequence->intrinsics().cx_px, kCamera.cx_px, 1e-6);
      EXPECT_NEAR(sequence->intrinsics().fy_px, kCamera.fy_px, 1e-6);
      for (std::size_t k = 0; k < 5; ++k) {
        const reconstruction::RgbdFrame frame = sequence->load(k);
        EXPECT_EQ(frame.rgb(7, 7), (core::Rgb8{static_cast<std::uint8_t>(20 * k), 90, 30}));
        EXPECT_NEAR(frame.depth_m(8, 20), Recording::depth_m(8), in_mm ? 6e-4 : 2e-4);
        EXPECT_TRUE(std::isnan(frame.depth_m(0, 0)));
        const auto pose = Recording::pose(0.1 * static_cast<double>(k));
        const auto T_world_camera =
            core::transform_from_pose2<core::frame::World>(pose) * core::mast_camera(1.0, 0.1);
        const glm::dvec3 off_m =
            frame.T_world_camera.translation_m() - T_world_camera.translation_m();
        EXPECT_LT(glm::length(off_m), 1e-3) << k;
        const glm::dquat R =
            glm::conjugate(frame.T_world_camera.rotation()) * T_world_camera.rotation();
        EXPECT_GT(std::abs(R.w), 1.0 - 1e-6) << k;
      }
    }
  }
}

/// The messages of a file as rosbag2's SQLite files have them.
void write_database(const fs::path& from, const fs::path& to) {
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(to.c_str(), &database), SQLITE_OK);
  const char* const kTables =
      "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
      "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
      "timestamp INTEGER NOT NULL, data BLOB NOT NULL);";
  ASSERT_EQ(sqlite3_exec(database, kTables, nullptr, nullptr, nullptr), SQLITE_OK);
  const auto insert = [&](const char* text, auto&& bind) {
    sqlite3_stmt* statement = nullptr;
    ASSERT_EQ(sqlite3_prepare_v2(database, text, -1, &statement, nullptr), SQLITE_OK);
    bind(statement);
    ASSERT_EQ(sqlite3_step(statement), SQLITE_DONE);
    sqlite3_finalize(statement);
  };
  ros::mcap::Reader reader(from);
  std::map<std::string, int> ids;
  for (const ros::mcap::Channel* channel : reader.channels()) {
    const int id = ids[channel->topic] = static_cast<int>(ids.size()) + 1;
    insert("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", [&](sqlite3_stmt* to_bind) {
      sqlite3_bind_int(to_bind, 1, id);
      sqlite3_bind_text(to_bind, 2, channel->topic.c_str(), -1, nullptr);
      sqlite3_bind_text(to_bind, 3, channel->schema.name.c_str(), -1, nullptr);
    });
  }
  reader.read([&](const ros::mcap::StoredMessage& message) {
    insert("INSERT INTO messages VALUES(NULL, ?, ?, ?)", [&](sqlite3_stmt* to_bind) {
      sqlite3_bind_int(to_bind, 1, ids.at(message.channel->topic));
      sqlite3_bind_int64(to_bind, 2, static_cast<std::int64_t>(message.log_time_ns));
      sqlite3_bind_blob(to_bind, 3, message.data.data(), static_cast<int>(message.data.size()),
                        nullptr);
    });
  });
  sqlite3_close(database);
}

TEST_F(UnpackRecording, SqliteFilesOfRosbag2AreRead) {
  (void)unpack({});
  const std::string poses = core::read_file(folder_ / "unpacked/groundtruth.txt");
  write_database(folder_ / "a.mcap", folder_ / "a.db3");
  (void)unpack_recording(folder_ / "a.db3", folder_ / "unpacked", {});
  EXPECT_EQ(core::read_file(folder_ / "unpacked/groundtruth.txt"), poses);
  EXPECT_EQ(open()->frame_count(), 5U);

  fs::resize_file(folder_ / "a.db3", fs::file_size(folder_ / "a.db3") / 2);
  EXPECT_THAT(tests::input_error_of([&] {
                (void)unpack_recording(folder_ / "a.db3", folder_ / "unpacked", {});
              }),
              HasSubstr("a.db3: expected"));
}

TEST_F(UnpackRecording, FilesOfOneRecordingFollowOneAnother) {
  Recording recording{.images = 4};
  fs::create_directories(folder_ / "bag");
  for (int part = 0; part < 11; part += 5) {
    recording.write(folder_ / "bag" / ("bag_" + std::to_string(part) + ".mcap"));
    recording.epoch_ns += 4 * kPeriod_ns;
  }
  // Each file tells the pose from its own start on; the last image of all is behind them.
  const UnpackSummary summary = unpack_recording(folder_ / "bag", folder_ / "unpacked", {});
  EXPECT_EQ(summary.color_images, 11U);
  EXPECT_EQ(summary.without_pose, 1U);
}

TEST_F(UnpackRecording, WhatIsMissingIsNamed) {
  EXPECT_THAT(error({.color_topic = "/rgb"}),
              HasSubstr("expected the topic /camera/image_raw (Image), found /rgb, "));
  EXPECT_THAT(error({.with_tf = false}), HasSubstr("expected transforms from cam to cam"));
  EXPECT_THAT(error({.depth_frame = "ir"}),
              HasSubstr("colour and depth of one view (frame cam), found frame ir"));
  EXPECT_THAT(
      error({}, {.fixed_frame = "map"}),
      HasSubstr("expected transforms from map to cam, where images were taken, found cam "
                "in base in odom"));
  EXPECT_THAT(error({.images = 1}), HasSubstr("images whose pose in odom is known"));
}

TEST_F(UnpackRecording, AnotherFolderIsNotReplaced) {
  fs::create_directories(folder_ / "unpacked");
  EXPECT_THAT(error({}), HasSubstr("expected no folder, or one that was unpacked"));
}

TEST_F(UnpackRecording, WhatIsLeftOfAFileIsUnpacked) {
  Recording{.images = 40}.write(folder_ / "a.mcap");
  ros::mcap::Reader whole(folder_ / "a.mcap");
  fs::resize_file(folder_ / "a.mcap", fs::file_size(folder_ / "a.mcap") - 100);
  const UnpackSummary summary = unpack_recording(folder_ / "a.mcap", folder_ / "unpacked", {});
  EXPECT_EQ(summary.color_images, 39U);
  EXPECT_THAT(summary.truncation, HasSubstr("the end of the file"));
}

}  // namespace
}  // namespace segsim::experiments::bags
