// `segsim ros serve` with a pilot in another process: this one.
#include <atomic>
#include <csignal>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/dds/topic_io.h"
#include "ros/messages/geometry_msgs.h"
#include "ros/messages/sensor_msgs.h"
#include "ros/messages/std_msgs.h"
#include "segsim_process.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/ros/dds/loopback.h"
#include "tests/system/gazebo_processes.h"
#include "tests/temporary_folder.h"

namespace segsim::tests {
namespace {

using testing::HasSubstr;

constexpr int kDomain = 75;
constexpr double kPatience_s = 120.0;

class RosCli : public testing::Test {
 protected:
  void SetUp() override {
    bundle_ = experiments::TinyScene().write(folder_.path() / "tiny").string();
  }
  [[nodiscard]] std::vector<std::string> command(
      const std::vector<std::string>& more, const char* config = ros::dds::kLoopback) const {
    std::vector<std::string> words{
        SEGSIM_BINARY,  "ros",   "serve",    bundle_,
        "--goal",       "couch", "--domain", std::to_string(kDomain),
        "--dds-config", config,  "--work",   (folder_.path() / "work").string(),
        "--width",      "96",    "--height", "72",
        "--backend",    "cpu",   "--wait",   "60"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }

  TemporaryFolder folder_{"ros_cli"};
  std::string bundle_;
};

/// Drives on at every image, and says that it has found the goal at one of them.
class Pilot {
 public:
  explicit Pilot(int last_image) : last_(last_image) {}
  ~Pilot() {
    gone_ = true;
    thread_.join();
  }
  Pilot(const Pilot&) = delete;
  Pilot& operator=(const Pilot&) = delete;

 private:
  void fly() {
    const auto transport =
        ros::dds::open_transport({.domain = kDomain, .config = ros::dds::kLoopback});
    ros::dds::TopicReader<ros::sensor_msgs::Image> images(*transport, "/camera/image_raw");
    ros::dds::TopicWriter<ros::geometry_msgs::Twist> command(*transport, "/cmd_vel");
    ros::dds::TopicWriter<ros::std_msgs::Bool> stop(*transport, "/stop");
    int seen = 0;
    while (!gone_) {
      (void)transport->wait(0.02);
      while (images.take()) {
        if (++seen == last_) {
          stop.write({true});
        } else if (seen < last_) {
          command.write({{0.1, 0.0, 0.0}, {0.0, 0.0, 0.3}});
        }
      }
    }
  }
  int last_;
  std::atomic<bool> gone_{false};
  std::thread thread_{[this] { fly(); }};
};

TEST_F(RosCli, WithoutDdsItSaysWhichPackageIsMissing) {
  if (ros::dds::has_transport()) GTEST_SKIP() << "this program has it";
  const ProcessOutput run = run_segsim("ros serve '" + bundle_ + "' --goal couch");
  expect_input_error(run, "ROS 2");
  EXPECT_THAT(run.text, HasSubstr("cyclonedds-dev"));
}

class RosServe : public RosCli {
 protected:
  void SetUp() override {
    if (!ros::dds::has_transport()) GTEST_SKIP() << "no DDS";
    RosCli::SetUp();
  }
};

TEST_F(RosServe, DrivesUntilThePilotStopsItAndTellsTheOutcome) {
  std::string log;
  {
    Pilot pilot(20);
    Process server(command({"--start", "-2,0,90"}), "", folder_.path() / "log");
    EXPECT_EQ(server.wait(kPatience_s), 0);
    log = server.output();
  }
  EXPECT_THAT(log, HasSubstr("robot at -2.00, 0.00 m, 90 degrees, searching \"couch\""));
  EXPECT_THAT(log, HasSubstr("outcome: stopped_far after 1.9 s (simulated), 20 images"));
}

TEST_F(RosServe, ByFastDdsItIsDrivenByAPilotOfCycloneAsWell) {
  if (!ros::dds::has_transport(ros::dds::Implementation::kFast)) GTEST_SKIP() << "no Fast DDS";
  Pilot pilot(20);
  Process server(command({"--start", "-2,0,90", "--dds", "fast"}, ros::dds::kFastLoopback), "",
                 folder_.path() / "log");
  EXPECT_EQ(server.wait(kPatience_s), 0);
  EXPECT_THAT(server.output(),
              HasSubstr("outcome: stopped_far after 1.9 s (simulated), 20 images"));
}

TEST_F(RosServe, InRealTimeItEndsWithItsTimeAlsoIfNobodyCommands) {
  Pilot pilot(-1);
  Process server(command({"--realtime", "--time-limit", "1", "--rate", "5"}), "",
                 folder_.path() / "log");
  EXPECT_EQ(server.wait(kPatience_s), 0);
  EXPECT_THAT(server.output(), HasSubstr("outcome: timeout after 1.0 s"));
}

TEST_F(RosServe, ASignalEndsItWhileItWaits) {
  Process server(command({}), "", folder_.path() / "log");
  ASSERT_TRUE(server.says("waiting for a publisher of /cmd_vel", kPatience_s));
  EXPECT_EQ(server.stop(SIGINT), 0);
  EXPECT_THAT(server.output(), HasSubstr("stopped by a signal after 0 images"));
}

TEST_F(RosServe, APilotThatFallsSilentIsToldWithExitCode1) {
  const auto transport =
      ros::dds::open_transport({.domain = kDomain, .config = ros::dds::kLoopback});
  const ros::dds::TopicWriter<ros::geometry_msgs::Twist> silent(*transport, "/cmd_vel");
  Process server(command({"--answer", "0.1"}), "", folder_.path() / "log");
  EXPECT_EQ(server.wait(kPatience_s), 1);
  EXPECT_THAT(server.output(), HasSubstr("expected a command on /cmd_vel"));
}

TEST_F(RosServe, WhatDoesNotFitIsRefused) {
  const std::string serve = "ros serve '" + bundle_ + "' ";
  expect_input_error(run_segsim(serve + "--goal sofa"), "--goal");
  expect_input_error(run_segsim(serve + "--goal couch --rate 7"), "--rate");
  expect_input_error(run_segsim(serve + "--goal couch --work '" + folder_.path().string() +
                                "/w' --start 100,0,0"),
                     "--start");
  const ProcessOutput domain = run_shell("ROS_DOMAIN_ID=x " + std::string(SEGSIM_BINARY) +
                                         " " + serve + "--goal couch");
  expect_input_error(domain, "ROS_DOMAIN_ID");
}

}  // namespace
}  // namespace segsim::tests
