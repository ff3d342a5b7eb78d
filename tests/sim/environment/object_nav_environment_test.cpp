#include "sim/trial/environment/object_nav_environment.h"

#include <cmath>

#include <gtest/gtest.h>

#include "core/error.h"
#include "core/random.h"
#include "tests/sim/environment/two_rooms.h"

namespace segsim::sim {
namespace {

class ObjectNavEnvironmentTest : public testing::Test {
 protected:
  /// Steps with one command each, as long as the episode lasts.
  /// @return  Poses before every step and at the end.
  std::vector<core::Pose2> drive(ObjectNavEnvironment& environment,
                                 const std::vector<core::VelocityCommand>& commands) {
    std::vector<core::Pose2> poses{environment.pose()};
    for (const core::VelocityCommand& command : commands) {
      if (environment.over()) break;
      last_ = environment.step({false, {&command, 1}}, *renderer_);
      rewards_ += last_.reward;
      collided_ = collided_ || last_.collided;
      poses.push_back(environment.pose());
    }
    return poses;
  }
  EnvironmentStep stop(ObjectNavEnvironment& environment) {
    last_ = environment.step({true, {}}, *renderer_);
    rewards_ += last_.reward;
    return last_;
  }
  /// The same commands, then STOP, in an environment and in a trial.
  void expect_as_trial(const Episode& episode,
                       const std::vector<core::VelocityCommand>& commands, bool stops) {
    ObjectNavEnvironment environment(rooms_.world, rooms_.options);
    environment.reset(episode, nullptr, *renderer_);
    const std::vector<core::Pose2> poses = drive(environment, commands);
    if (stops && !environment.over()) stop(environment);
    const TrialResult ours = environment.result();
    const TrialResult trial = rooms_.trial(episode, commands, stops);
    ASSERT_LE(trial.track.size(), poses.size());
    for (std::size_t k = 0; k < trial.track.size(); ++k) {
      ASSERT_EQ(poses[k].x_m, trial.track[k].pose.x_m) << k;
      ASSERT_EQ(poses[k].y_m, trial.track[k].pose.y_m) << k;
      ASSERT_EQ(poses[k].yaw_rad, trial.track[k].pose.yaw_rad) << k;
    }
    EXPECT_EQ(ours.outcome, trial.outcome) << to_string(trial.outcome);
    EXPECT_EQ(ours.success, trial.success);
    EXPECT_EQ(ours.spl, trial.spl);
    EXPECT_EQ(ours.soft_spl, trial.soft_spl);
    EXPECT_EQ(ours.path_m, trial.path_m);
    EXPECT_EQ(ours.distance_to_goal_m, trial.distance_to_goal_m);
    EXPECT_EQ(ours.contacts, trial.contacts);
    EXPECT_EQ(ours.sim_s, trial.sim_s);
    EXPECT_EQ(ours.final_pose.x_m, trial.final_pose.x_m);
    if (trial.stop_reason) {  // Else nobody looked at labels here.
      EXPECT_EQ(ours.final_goal_pixels, trial.final_goal_pixels);
    }
    outcome_ = ours.outcome;
  }

  TwoRooms rooms_;
  std::unique_ptr<core::Renderer> renderer_ = TwoRooms::make_renderer();
  EnvironmentStep last_;
  double rewards_ = 0.0;
  bool collided_ = false;
  Outcome outcome_ = Outcome::kTimeout;
};

std::vector<core::VelocityCommand> to_the_couch() {
  std::vector<core::VelocityCommand> commands(44, {0.8, 0.0});
  commands.resize(50);
  return commands;
}

std::vector<core::VelocityCommand> random_commands(std::uint64_t seed, int count) {
  core::RandomStream random(seed, "random_commands");
  std::vector<core::VelocityCommand> commands;
  for (int k = 0; k < count; ++k) {
    commands.push_back({random.uniform(-0.3, 1.0), random.uniform(-2.0, 2.0)});
  }
  return commands;
}

TEST_F(ObjectNavEnvironmentTest, ASuccessIsThatOfTheTrial) {
  expect_as_trial(rooms_.episode(), to_the_couch(), true);
  EXPECT_EQ(outcome_, Outcome::kSuccess);
}

TEST_F(ObjectNavEnvironmentTest, RandomDrivesAndTheirContactsAreThoseOfTheTrial) {
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    expect_as_trial(rooms_.episode(), random_commands(seed, 250), true);
  }
  EXPECT_TRUE(collided_);
  EXPECT_NE(outcome_, Outcome::kSuccess);
}

TEST_F(ObjectNavEnvironmentTest, EveryWayOfMotionIsThatOfTheTrial) {
  TrialOptions& options = rooms_.options.trial;
  options.contact_response = ContactResponse::kSlide;
  expect_as_trial(rooms_.episode(), random_commands(7, 200), true);
  options.collision = CollisionMode::kNavmesh;
  expect_as_trial(rooms_.episode(), random_commands(8, 200), true);
  options.control_period_s = 0.35;  // Beyond the command timeout of the base.
  expect_as_trial(rooms_.episode(), random_commands(9, 60), true);
  options = TwoRooms().options.trial;
  options.stop_on_contact = true;
  expect_as_trial(rooms_.episode(), std::vector<core::VelocityCommand>(100, {0.8, 0.3}), true);
  EXPECT_EQ(outcome_, Outcome::kCollision);
  EXPECT_TRUE(last_.terminated && last_.collided && !last_.truncated);
}

TEST_F(ObjectNavEnvironmentTest, TimeRunsOutAsInATrial) {
  rooms_.options.trial.time_limit_s = 2.0;
  expect_as_trial(rooms_.episode(), std::vector<core::VelocityCommand>(40, {0.3, 0.2}), false);
  EXPECT_EQ(outcome_, Outcome::kTimeout);
  EXPECT_TRUE(last_.truncated && !last_.terminated);
  // A STOP at the limit itself is in time.
  expect_as_trial(rooms_.episode(), std::vector<core::VelocityCommand>(20, {0.3, 0.2}), true);
  EXPECT_EQ(outcome_, Outcome::kStoppedFar);
  EXPECT_TRUE(last_.terminated && !last_.truncated);
}

TEST_F(ObjectNavEnvironmentTest, RewardIsTheWayThatTheGoalCameNearer) {
  ObjectNavEnvironment environment(rooms_.world, rooms_.options);
  const Episode episode = rooms_.episode();
  environment.reset(episode, nullptr, *renderer_);
  const double start_m = environment.result().distance_to_goal_m;
  EXPECT_NEAR(start_m, episode.shortest_path_m, 1e-12);
  drive(environment, to_the_couch());
  const double driven = rewards_;
  EXPECT_NEAR(driven, start_m - environment.result().distance_to_goal_m, 1e-9);
  EXPECT_GT(driven, 3.0);
  stop(environment);
  EXPECT_NEAR(rewards_ - driven, rooms_.options.success_reward, 1e-9);
  // Switched off, nothing is worth anything.
  rewards_ = 0.0;
  rooms_.options.rewards = false;
  ObjectNavEnvironment without(rooms_.world, rooms_.options);
  without.reset(episode, nullptr, *renderer_);
  drive(without, to_the_couch());
  EXPECT_TRUE(stop(without).terminated && without.result().success);
  EXPECT_EQ(rewards_, 0.0);
}

TEST_F(ObjectNavEnvironmentTest, TheRobotKnowsItsWayFromTheStart) {
  ObjectNavEnvironment environment(rooms_.world, rooms_.options);
  environment.reset(rooms_.episode({1.0, 2.0, 1.5707963267948966}), nullptr, *renderer_);
  EXPECT_EQ(environment.pose_since_start().x_m, 0.0);
  EXPECT_EQ(environment.pose_since_start().yaw_rad, 0.0);
  drive(environment, std::vector<core::VelocityCommand>(10, {0.8, 0.0}));
  EXPECT_NEAR(environment.pose_since_start().x_m, environment.pose().y_m - 2.0, 1e-9);
  EXPECT_NEAR(environment.pose_since_start().y_m, 0.0, 1e-9);
  // With odometry it errs, and the truth does not show.
  rooms_.options.trial.odometry = OdometryNoise::skid_steered_indoors();
  ObjectNavEnvironment erring(rooms_.world, rooms_.options);
  erring.reset(rooms_.episode({1.0, 2.0, 1.5707963267948966}), nullptr, *renderer_);
  drive(erring, std::vector<core::VelocityCommand>(10, {0.8, 0.0}));
  EXPECT_EQ(erring.pose().y_m, environment.pose().y_m);
  EXPECT_NE(erring.pose_since_start().x_m, environment.pose_since_start().x_m);
  EXPECT_NEAR(erring.pose_since_start().x_m, environment.pose_since_start().x_m, 0.2);
}

TEST_F(ObjectNavEnvironmentTest, ObservationsAreWhatATrialsPolicySees) {
  ObjectNavEnvironment environment(rooms_.world, rooms_.options);
  environment.reset(rooms_.episode(), nullptr, *renderer_);
  drive(environment, std::vector<core::VelocityCommand>(8, {0.5, 0.4}));
  const auto trial_eye = TwoRooms::make_renderer();
  const core::Frame seen =
      trial_eye->render(core::transform_from_pose2<core::frame::World>(environment.pose()) *
                            core::mast_camera(1.2, 0.0),
                        rooms_.options.trial.camera, core::Channels::kRgbd);
  bool far = false, near = false;
  for (std::size_t k = 0; k < seen.depth_m.size(); ++k) {
    const float exact = seen.depth_m.pixels()[k], measured = environment.depth_m().pixels()[k];
    if (exact <= 6.0F) {
      EXPECT_EQ(measured, exact);
      near = true;
    } else {
      EXPECT_TRUE(std::isnan(measured)) << "beyond the camera's range";
      far = true;
    }
  }
  EXPECT_TRUE(far && near);
}

TEST_F(ObjectNavEnvironmentTest, AStepOfSeveralCommandsTakesOneImage) {
  class Counting final : public core::Renderer {
   public:
    using core::Renderer::render;
    void render(const core::CameraPose& pose, const core::CameraIntrinsics& camera,
                core::Channels channels, core::Frame& frame) override {
      ++images;
      labelled += core::has(channels, core::Channels::kLabels) ? 1 : 0;
      eye->render(pose, camera, channels, frame);
    }
    std::unique_ptr<core::Renderer> eye = TwoRooms::make_renderer();
    int images = 0, labelled = 0;
  } counting;
  ObjectNavEnvironment environment(rooms_.world, rooms_.options);
  environment.reset(rooms_.episode(), nullptr, counting);
  const std::vector<core::VelocityCommand> commands(8, {0.5, 0.0});
  static_cast<void>(environment.step({false, commands}, counting));
  EXPECT_EQ(environment.time_ns(), 800'000'000);
  EXPECT_EQ(counting.images, 2);
  EXPECT_EQ(counting.labelled, 0);
  static_cast<void>(environment.step({true, {}}, counting));
  EXPECT_EQ(counting.labelled, 1) << "for the judge";
}

TEST_F(ObjectNavEnvironmentTest, AStartInAWallIsRefused) {
  ObjectNavEnvironment environment(rooms_.world, rooms_.options);
  EXPECT_THROW(environment.reset(rooms_.episode({2.95, 1.0, 0.0}), nullptr, *renderer_),
               core::InputError);
}

}  // namespace
}  // namespace segsim::sim
