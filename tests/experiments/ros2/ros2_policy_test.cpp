// The robot's node and the policy behind it, with a pilot in the same process.
#include "experiments/ros2/ros2_policy.h"

#include <limits>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/ros2/ros_messages.h"
#include "ros/dds/topic_io.h"
#include "ros/messages/rosgraph_msgs.h"
#include "tests/error_message.h"
#include "tests/ros/dds/loopback.h"

namespace segsim::experiments::ros2 {
namespace {

using ros::dds::TopicReader;
using ros::dds::TopicWriter;
using ros::geometry_msgs::Twist;
using ros::geometry_msgs::TwistStamped;
using testing::HasSubstr;
using tests::input_error_of;

constexpr int kDomain = 72;

nav::Ros2Settings settings() {
  nav::Ros2Settings settings;
  settings.domain = kDomain;
  settings.config = ros::dds::kLoopback;
  return settings;
}

Twist twist(double forward_mps, double turn_radps) {
  return {{forward_mps, 0.0, 0.0}, {0.0, 0.0, turn_radps}};
}

/// The other side. Within a process messages arrive while they are written.
struct Pilot {
  std::unique_ptr<ros::dds::Transport> transport = ros::dds::open_transport(
      {.domain = kDomain, .node = "pilot", .config = ros::dds::kLoopback});
  TopicReader<ros::sensor_msgs::Image> colour{*transport, "/camera/image_raw", {.depth = 100}};
  TopicWriter<ros::std_msgs::Bool> stop{*transport, "/stop"};
};
struct PlainPilot : Pilot {
  TopicWriter<Twist> command{*transport, "/cmd_vel"};
};

/// What the robot sees at the given time.
struct Seen {
  explicit Seen(core::TimeNs time_ns = 0) {
    observation.capture_time_ns = time_ns;
    observation.intrinsics = core::CameraIntrinsics::from_fov(8, 6, 1.2);
    observation.T_robot_camera = core::mast_camera(1.0, 0.1);
    observation.T_odom_robot =
        core::transform_from_pose2<core::frame::Odom>({1.0, 2.0, core::seconds(time_ns)});
    observation.rgb = &rgb;
    observation.depth_m = &depth_m;
  }
  core::Image<core::Rgb8> rgb{8, 6, {1, 2, 3}};
  core::Image<float> depth_m{8, 6, 2.5F};
  core::Observation observation;
  std::vector<core::Detection> detections{{1, 0.75F, {1.0F, 2.0F, 4.0F, 5.0F}}};
};

class Ros2PolicyTest : public testing::Test {
 protected:
  Ros2Policy policy(const nav::Ros2Settings& of = settings()) {
    robot_ = std::make_shared<RobotNode>(of);
    return Ros2Policy(robot_, of, {"chair", "couch"});
  }
  static core::Decision decide(Ros2Policy& policy, core::TimeNs time_ns = 0) {
    const Seen seen(time_ns);
    return policy.decide(seen.observation, seen.detections);
  }
  std::shared_ptr<RobotNode> robot_;
};

TEST_F(Ros2PolicyTest, PublishesAllThatItSeesAndObeysTheAnswer) {
  const auto of = settings();
  Ros2Policy robot = policy(of);
  PlainPilot pilot;
  ros::dds::Transport& transport = *pilot.transport;
  TopicReader<ros::rosgraph_msgs::Clock> clock(transport, "/clock");
  TopicReader<ros::tf2_msgs::TFMessage> tf(transport, "/tf");
  TopicReader<ros::sensor_msgs::Image> depth(transport, "/camera/depth/image_raw");
  TopicReader<ros::sensor_msgs::CameraInfo> info(transport, "/camera/camera_info");
  TopicReader<ros::vision_msgs::Detection2DArray> found(transport, "/detections");
  TopicReader<ros::nav_msgs::Odometry> odometry(transport, "/odom");
  const core::TimeNs time_ns = 500'000'000;
  std::optional<ros::sensor_msgs::Image> colour;
  std::thread answers([&] {
    while (!(colour = pilot.colour.take())) (void)transport.wait(0.1);
    pilot.command.write(twist(0.3, -0.2));
  });
  robot.reset({"couch", 1}, 1);
  const Seen seen(time_ns);
  const core::Decision decision = robot.decide(seen.observation, seen.detections);
  answers.join();
  EXPECT_EQ(decision.command.forward_mps, 0.3);
  EXPECT_EQ(decision.command.turn_radps, -0.2);
  EXPECT_EQ(decision.stop, std::nullopt);

  const auto header = ros_header(time_ns, kCameraFrame);
  ros::sensor_msgs::Image image;
  image.header = header;
  to_ros(seen.rgb, image);
  EXPECT_EQ(colour, image);
  to_ros(seen.depth_m, image);
  EXPECT_EQ(depth.take(), image);
  EXPECT_EQ(info.take(), ros_camera_info(seen.observation.intrinsics, header));
  EXPECT_EQ(found.take(), ros_detections(seen.detections, {"chair", "couch"}, header));
  EXPECT_EQ(clock.take(), ros::rosgraph_msgs::Clock{ros_time(time_ns)});
  const auto pose = tf.take();
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->transforms.at(0).child_frame_id, kBaseFrame);
  EXPECT_NEAR(odometry.take().value().pose.pose.position.y, 2.0, 1e-12);

  // What is latched waits for who comes later.
  TopicReader<ros::std_msgs::String> goal(transport, "/goal_object",
                                          {.transient_local = true, .depth = 1});
  TopicReader<ros::tf2_msgs::TFMessage> mounts(transport, "/tf_static",
                                               {.transient_local = true, .depth = 1});
  EXPECT_EQ(goal.take(), ros::std_msgs::String{"couch"});
  EXPECT_EQ(mounts.take(), ros_mounts(seen.observation, nullptr));
}

TEST_F(Ros2PolicyTest, AStopEndsTheSearchAsItSays) {
  Ros2Policy robot = policy();
  PlainPilot pilot;
  for (const bool found : {true, false}) {
    robot.reset({"couch", 1}, 1);
    std::thread answers([&] {
      while (!pilot.colour.take()) (void)pilot.transport->wait(0.1);
      pilot.stop.write({found});
    });
    const core::Decision decision = decide(robot);
    answers.join();
    EXPECT_EQ(decision.mode, core::PolicyMode::kStop);
    EXPECT_EQ(decision.stop,
              found ? core::StopReason::kGoalReached : core::StopReason::kNothingNew);
  }
}

TEST_F(Ros2PolicyTest, AStopBetweenTwoImagesCounts) {
  Ros2Policy robot = policy();
  PlainPilot pilot;
  pilot.stop.write({true});  // Of the episode before.
  robot.reset({"couch", 1}, 1);
  pilot.command.write(twist(9.0, 0.0));
  pilot.stop.write({false});
  EXPECT_EQ(decide(robot).stop, core::StopReason::kNothingNew);
}

TEST_F(Ros2PolicyTest, StampedCommandsAreHeardIfAskedFor) {
  auto of = settings();
  of.stamped = true;
  Ros2Policy robot = policy(of);
  Pilot pilot;
  TopicWriter<TwistStamped> command(*pilot.transport, "/cmd_vel");
  robot.reset({"couch", 1}, 1);
  std::thread answers([&] {
    while (!pilot.colour.take()) (void)pilot.transport->wait(0.1);
    command.write({ros_header(0, kBaseFrame), twist(0.1, 0.2)});
  });
  const core::Decision decision = decide(robot);
  answers.join();
  EXPECT_EQ(decision.command.turn_radps, 0.2);
}

TEST_F(Ros2PolicyTest, CommandsFromBeforeAnImageAreNoAnswersToIt) {
  Ros2Policy robot = policy();
  PlainPilot pilot;
  robot.reset({"couch", 1}, 1);
  pilot.command.write(twist(9.0, 0.0));
  pilot.command.write(twist(8.0, 0.0));
  std::thread answers([&] {
    while (!pilot.colour.take()) (void)pilot.transport->wait(0.1);
    pilot.command.write(twist(0.5, 0.0));
  });
  EXPECT_EQ(decide(robot).command.forward_mps, 0.5);
  answers.join();
  EXPECT_EQ(robot_->traffic().superseded, 2U);
  EXPECT_EQ(robot_->traffic().commands, 1U);
}

TEST_F(Ros2PolicyTest, TheFirstImageIsSentAgainUntilSomebodyAnswers) {
  Ros2Policy robot = policy();
  PlainPilot pilot;
  robot.reset({"couch", 1}, 1);
  std::thread answers([&] {
    for (int heard = 0; heard < 2;) {  // As if the first one had been lost.
      (void)pilot.transport->wait(0.1);
      while (pilot.colour.take()) ++heard;
    }
    pilot.command.write(twist(0.5, 0.0));
  });
  EXPECT_EQ(decide(robot).command.forward_mps, 0.5);
  answers.join();
}

TEST_F(Ros2PolicyTest, ALostCommandIsToldWithItsImage) {
  auto of = settings();
  of.answer_s = 0.05;
  Ros2Policy robot = policy(of);
  const PlainPilot silent;
  robot.reset({"couch", 1}, 1);
  for (int lost = 0; lost < 2; ++lost) {
    EXPECT_THAT(input_error_of([&] { (void)decide(robot, 250'000'000); }),
                HasSubstr("ROS 2, domain 72: expected a command on /cmd_vel "
                          "(geometry_msgs/msg/Twist) within 0.05 s of the image at 0.250 s"));
  }
}

TEST_F(Ros2PolicyTest, WhereNobodySendsCommandsNoEpisodeBegins) {
  auto of = settings();
  of.start_s = 0.05;
  Ros2Policy robot = policy(of);
  EXPECT_THAT(input_error_of([&] {
                robot.reset({"couch", 1}, 1);
              }),
              HasSubstr("expected a publisher of /cmd_vel (geometry_msgs/msg/Twist) within "
                        "0.05 s, found none"));
}

TEST_F(Ros2PolicyTest, ACommandThatIsNoVelocityIsRefused) {
  Ros2Policy robot = policy();
  PlainPilot pilot;
  robot.reset({"couch", 1}, 1);
  std::thread answers([&] {
    while (!pilot.colour.take()) (void)pilot.transport->wait(0.1);
    pilot.command.write(twist(std::numeric_limits<double>::quiet_NaN(), 0.0));
  });
  EXPECT_THAT(input_error_of([&] { (void)decide(robot); }), HasSubstr("finite velocities"));
  answers.join();
}

TEST_F(Ros2PolicyTest, WithoutWaitingTheNewestCommandCounts) {
  auto of = settings();
  of.waits = false;
  Ros2Policy robot = policy(of);
  PlainPilot pilot;
  robot.reset({"couch", 1}, 1);
  EXPECT_EQ(decide(robot).command.forward_mps, 0.0);
  pilot.command.write(twist(0.1, 0.0));
  pilot.command.write(twist(0.2, 0.0));
  EXPECT_EQ(decide(robot).command.forward_mps, 0.2);
  EXPECT_EQ(robot_->traffic().superseded, 1U);
}

TEST_F(Ros2PolicyTest, WhatTheSceneKnowsIsPublishedOnRequestAlone) {
  auto of = settings();
  of.waits = false;
  {
    Ros2Policy robot = policy(of);
    PlainPilot pilot;
    TopicReader<ros::sensor_msgs::Image> labels(*pilot.transport, "/truth/panoptic");
    robot.reset({"couch", 1}, 1);
    (void)decide(robot);
    EXPECT_FALSE(labels.take());
    EXPECT_EQ(labels.writers(), 0);
  }
  robot_.reset();
  of.truth = of.map = of.depth_mm = true;
  Ros2Policy robot = policy(of);
  PlainPilot pilot;
  TopicReader<ros::sensor_msgs::Image> labels(*pilot.transport, "/truth/panoptic");
  TopicReader<ros::sensor_msgs::Image> depth(*pilot.transport, "/camera/depth/image_raw");
  TopicReader<ros::vision_msgs::Detection2DArray> boxes(*pilot.transport, "/truth/detections");
  robot.reset({"couch", 1}, 1);
  core::Frame frame;
  frame.semantic = core::Image<std::uint16_t>(8, 6, 3);
  frame.instance = core::Image<std::uint16_t>(8, 6, 2);
  const std::vector<core::Detection> found{{0, 1.0F, {0.0F, 0.0F, 8.0F, 6.0F}}};
  for (const core::TimeNs time_ns : {0, 100, 200}) {  // The middle one is not decided on.
    ImageTruth truth{time_ns, {}, found, {"bed"}};
    frame.instance(0, 0) = static_cast<std::uint16_t>(time_ns);
    labels_to_ros(frame, truth.labels);
    robot.keep(std::move(truth));
  }
  (void)decide(robot, 0);
  (void)decide(robot, 200);
  for (const core::TimeNs time_ns : {0, 200}) {
    const auto image = labels.take();
    ASSERT_TRUE(image);
    EXPECT_EQ(image->header, ros_header(time_ns, kCameraFrame));
    EXPECT_EQ(image->encoding, "32SC1");
    EXPECT_THAT(std::vector<std::uint8_t>(image->data.begin(), image->data.begin() + 8),
                testing::ElementsAre(time_ns, 0, 3, 0, 2, 0, 3, 0));
    EXPECT_EQ(boxes.take(), ros_detections(found, {"bed"}, image->header));
  }
  EXPECT_FALSE(labels.take());
  const auto millimetres = depth.take();
  ASSERT_TRUE(millimetres);
  EXPECT_EQ(millimetres->encoding, "16UC1");
  EXPECT_EQ(millimetres->data.at(0) + 256 * millimetres->data.at(1), 2500);
}

TEST_F(Ros2PolicyTest, ADomainHasOneRobot) {
  const Ros2Policy robot = policy();
  EXPECT_THAT(input_error_of([&] { RobotNode another(settings()); }),
              HasSubstr("ROS 2, domain 72: expected one robot at a time (--workers 1)"));
}

TEST_F(Ros2PolicyTest, ReadingsArePublishedOnceWhenTheyAreAvailable) {
  auto sensors = std::make_shared<sim::SensorSettings>();
  sensors->imu.emplace();
  Ros2Policy robot = policy();
  robot.mount(sensors);
  PlainPilot pilot;
  robot.reset({"couch", 1}, 1);
  TopicReader<ros::sensor_msgs::Imu> imu(*pilot.transport, "/imu");
  sim::SensorLog log;
  log.imu = {{10, 20, {}}, {20, 30, {}}};
  robot.hear(log, 25);
  EXPECT_EQ(imu.take().value().header.stamp.nanosec, 10U);
  EXPECT_EQ(imu.take(), std::nullopt);
  robot.hear(log, 40);
  EXPECT_EQ(imu.take().value().header.stamp.nanosec, 20U);
  EXPECT_EQ(imu.take(), std::nullopt);
  robot.hear(log, 50);
  EXPECT_EQ(imu.take(), std::nullopt);
}

}  // namespace
}  // namespace segsim::experiments::ros2
