// Runs whose robots somebody on a ROS 2 network drives.
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/results/stored_run.h"
#include "experiments/runs/run.h"
#include "experiments/specs/spec.h"
#include "ros/dds/topic_io.h"
#include "ros/messages/geometry_msgs.h"
#include "ros/messages/nav_msgs.h"
#include "ros/messages/sensor_msgs.h"
#include "ros/messages/vision_msgs.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"
#include "tests/ros/dds/loopback.h"
#include "tests/temporary_folder.h"

extern char** environ;

namespace segsim::experiments {
namespace {

using testing::HasSubstr;
using tests::input_error_of;

constexpr int kDomain = 73;

class Ros2Run : public testing::Test {
 protected:
  void SetUp() override { TinyScene().write(folder_.path() / "tiny"); }

  std::vector<records::TrialRow> run(const std::string& policy, double time_limit_s = 10.0,
                                     const std::string& work = "work", int workers = 1) {
    runs::RunOptions options;
    options.workers = workers;
    options.folders = {folder_.path(), folder_.path() / work};
    const std::string config = std::string(", config: '") + ros::dds::kLoopback + "'}";
    const TinySpec spec{.episodes = 2,
                        .arms = "  - {name: before, detector: oracle}\n",
                        .time_limit_s = time_limit_s,
                        .more = "policy: {type: ros2, domain: " + std::to_string(kDomain) +
                                policy + config + "\npictures: false\n"};
    (void)runs::run_experiment(
        specs::parse_spec(spec.text(), folder_.path() / "tiny.yaml", options.folders),
        options);
    return results::load_run(options.folders.work).trials;
  }

  tests::TemporaryFolder folder_;
};

/// Answers each image with a curve, until it goes.
class CirclingPilot {
 public:
  ~CirclingPilot() {
    gone_ = true;
    thread_.join();
  }

 private:
  void fly() {
    const auto transport =
        ros::dds::open_transport({.domain = kDomain, .config = ros::dds::kLoopback});
    ros::dds::TopicReader<ros::sensor_msgs::Image> images(*transport, "/camera/image_raw");
    ros::dds::TopicWriter<ros::geometry_msgs::Twist> command(*transport, "/cmd_vel");
    while (!gone_) {
      (void)transport->wait(0.02);
      while (images.take()) command.write({{0.1, 0.0, 0.0}, {0.0, 0.0, 0.5}});
    }
  }
  std::atomic<bool> gone_{false};
  std::thread thread_{[this] { fly(); }};
};

TEST_F(Ros2Run, EachImageGetsItsCommandAndTheSameTrialComesOut) {
  const CirclingPilot pilot;
  const auto once = run("", 5.0, "once"), again = run("", 5.0, "again");
  ASSERT_EQ(once.size(), 2U);
  for (std::size_t k = 0; k < once.size(); ++k) {
    EXPECT_EQ(once[k].error, "");
    EXPECT_EQ(once[k].outcome, records::TrialOutcome::kTimeout);
    EXPECT_EQ(once[k].why.images, once[k].ticks);
    EXPECT_GT(once[k].path_m, 0.1);
    EXPECT_EQ(once[k].state_hash, again[k].state_hash);
  }
}

/// Hears what the scene knows, from a run that was asked for it.
TEST_F(Ros2Run, MapLabelsAndBoxesOfTheSceneAreThereOnRequest) {
  const CirclingPilot pilot;
  const auto transport =
      ros::dds::open_transport({.domain = kDomain, .config = ros::dds::kLoopback});
  ros::dds::TopicReader<ros::nav_msgs::OccupancyGrid> maps(
      *transport, "/map", {.transient_local = true, .depth = 1});
  ros::dds::TopicReader<ros::sensor_msgs::Image> labels(*transport, "/truth/panoptic",
                                                        {.depth = 1000});
  ros::dds::TopicReader<ros::vision_msgs::Detection2DArray> boxes(
      *transport, "/truth/detections", {.depth = 1000});
  const auto trials = run(", truth: true, map: true", 10.0);
  ASSERT_EQ(trials.size(), 2U);
  EXPECT_EQ(trials[0].error, "");
  const auto map = maps.take();
  ASSERT_TRUE(map);
  // The rooms are 8.4 m x 5.4 m: walls around, the couch and a chair inside.
  EXPECT_NEAR(map->info.resolution * static_cast<float>(map->info.width), 8.4F, 1.0F);
  EXPECT_NEAR(map->info.resolution * static_cast<float>(map->info.height), 5.4F, 1.0F);
  const auto at = [&](double x_m, double y_m) {
    const auto& info = map->info;
    const auto i = static_cast<std::size_t>((x_m - info.origin.position.x) / info.resolution);
    const auto j = static_cast<std::size_t>((y_m - info.origin.position.y) / info.resolution);
    return static_cast<int>(map->data.at(j * info.width + i));
  };
  EXPECT_EQ(at(-2.0, -1.0), 0);
  EXPECT_EQ(at(-3.15, 1.6), 100) << "the chair's side";
  // In the middle of most boxes the labels say what the box does.
  int in_boxes = 0, with_things = 0;
  while (const auto image = labels.take()) {
    const auto found = boxes.take();
    ASSERT_TRUE(found);
    EXPECT_EQ(found->header, image->header);
    for (const auto& detection : found->detections) {
      const bool couch = detection.results.at(0).hypothesis.class_id == "couch";
      const auto x = static_cast<std::size_t>(detection.bbox.center.position.x);
      const auto y = static_cast<std::size_t>(detection.bbox.center.position.y);
      const std::size_t pixel = y * image->step + 4 * x;
      const int semantic = image->data.at(pixel + 2);
      ++in_boxes;
      with_things += semantic == (couch ? TinyScene::kCouch : TinyScene::kChair) ? 1 : 0;
    }
  }
  EXPECT_GT(with_things, 0);
  EXPECT_GT(2 * with_things, in_boxes);
}

TEST_F(Ros2Run, ATrialWithoutCommandsFailsWithItsCause) {
  const auto transport =
      ros::dds::open_transport({.domain = kDomain, .config = ros::dds::kLoopback});
  const ros::dds::TopicWriter<ros::geometry_msgs::Twist> silent(*transport, "/cmd_vel");
  const auto trials = run(", answer_s: 0.1");
  ASSERT_EQ(trials.size(), 2U);
  for (const records::TrialRow& trial : trials) {
    EXPECT_EQ(trial.outcome, records::TrialOutcome::kError);
    EXPECT_THAT(trial.error, HasSubstr("within 0.1 s of the image at 0.000 s, found none"));
  }
}

TEST_F(Ros2Run, WhatANetworkCannotHaveIsRefusedBeforeAnyTrial) {
  EXPECT_THAT(input_error_of([&] { (void)run("", 10.0, "work", 2); }),
              HasSubstr("--workers 1"));
  EXPECT_THAT(input_error_of([&] { (void)run(", commands: newest"); }),
              HasSubstr("clock: realtime for `commands: newest`"));
  EXPECT_THAT(input_error_of([&] { (void)run(", distro: lunar"); }), HasSubstr("jazzy"));
  EXPECT_THAT(input_error_of([&] { (void)run(", answer_s: 0"); }), HasSubstr("answer_s"));
}

/// tests/experiments/ros2/pilot.py: another implementation of everything.
class PythonPilot {
 public:
  PythonPilot() {
    const char* given = std::getenv("SEGSIM_DDS_PYTHON");
    std::string python = given != nullptr ? given : "python3";
    std::string script = PILOT, domain = std::to_string(kDomain);
    char* arguments[] = {python.data(), script.data(), domain.data(), nullptr};
    if (posix_spawnp(&pid_, python.c_str(), nullptr, nullptr, arguments, environ) != 0)
      pid_ = 0;
  }
  ~PythonPilot() {
    if (pid_ <= 0) return;
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  PythonPilot(const PythonPilot&) = delete;
  PythonPilot& operator=(const PythonPilot&) = delete;

 private:
  pid_t pid_ = 0;
};

bool python_has_cyclonedds() {
  const char* given = std::getenv("SEGSIM_DDS_PYTHON");
  const std::string python = given != nullptr ? given : "python3";
  return std::system(
             ("'" + python + "' -c 'import cyclonedds, numpy' >/dev/null 2>&1").c_str()) == 0;
}

TEST_F(Ros2Run, AnotherImplementationOfDdsDrivesToTheGoal) {
  if (!python_has_cyclonedds()) {
    GTEST_SKIP() << "no Python with cyclonedds and numpy (SEGSIM_DDS_PYTHON names one)";
  }
  const PythonPilot pilot;
  const auto trials = run(", answer_s: 60", 180.0);
  ASSERT_EQ(trials.size(), 2U);
  for (const records::TrialRow& trial : trials) EXPECT_EQ(trial.error, "");
  EXPECT_GE(std::count_if(trials.begin(), trials.end(),
                          [](const records::TrialRow& trial) { return trial.success; }),
            1);
}

}  // namespace
}  // namespace segsim::experiments
