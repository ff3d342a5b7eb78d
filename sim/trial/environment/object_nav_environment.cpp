#include "sim/trial/environment/object_nav_environment.h"

#include <cmath>
#include <utility>

#include "core/check.h"
#include "sim/trial/goal_objects.h"
#include "sim/trial/internal/robot_camera.h"
#include "sim/trial/internal/trial_drive.h"
#include "sim/trial/internal/trial_judge.h"

namespace segsim::sim {
namespace internal {

/// One episode from its start to its end: run_trial() without computer and policy.
struct RunningEpisode {
  RunningEpisode(const Episode& task, const World& world, const EnvironmentOptions& settings,
                 std::shared_ptr<const DistanceField> to_goal)
      : episode(task),
        options(settings),
        period_ns(std::llround(settings.trial.control_period_s * 1e9)),
        drive(episode, options.trial, world, world.robot()),
        camera(options.trial, episode.seed),
        goal(world.manifest(), episode),
        judge(to_goal ? TrialJudge(episode, options.trial, std::move(to_goal))
                      : TrialJudge(episode, options.trial, world)),
        believed_start(drive.estimate()) {}

  /// Takes an image where the robot stands.
  void look(core::Renderer& renderer) {
    camera.render(renderer, drive.pose(), options.channels, frame);
    camera.measure(captures++, frame.depth_m, depth_m);
    seen.reset();
    if (core::has(options.channels, core::Channels::kLabels))
      seen = look_for_goal(frame, goal);
  }
  /// What the judge sees in the newest image; drawn with labels if it has none.
  const GoalView& judged_view(core::Renderer& renderer) {
    if (!seen) {
      camera.render(renderer, drive.pose(), kJudgedChannels, judged_frame);
      seen = look_for_goal(judged_frame, goal);
    }
    return *seen;
  }

  /// @return  Whether the robot moved.
  bool drive_by(std::span<const core::VelocityCommand> commands, EnvironmentStep& step) {
    bool moved = false;
    for (const core::VelocityCommand& command : commands) {
      drive.set_command(command);
      const core::TimeNs next_ns = drive.time_ns() + period_ns;
      step.truncated = !judge.in_time(next_ns);
      if (step.truncated) break;
      drive.begin_tick();
      moved = true;
      step.terminated = !drive.drive_to(next_ns);
      step.collided = step.collided || drive.in_contact();
      if (step.terminated) {
        judge.collided();
        break;
      }
    }
    return moved;
  }

  /// Metres that the goal came nearer since the last call. Off the navigable area there is no
  /// distance: the last one holds until there is one again.
  double progress() {
    const double now_m = judge.distance_m(drive.pose());
    if (!std::isfinite(now_m)) return 0.0;
    const double before_m = std::exchange(distance_m, now_m);
    return std::isfinite(before_m) ? before_m - now_m : 0.0;
  }

  Episode episode;
  const EnvironmentOptions& options;
  core::TimeNs period_ns;
  TrialDrive drive;
  RobotCamera camera;
  GoalObjects goal;
  TrialJudge judge;
  core::Pose2 believed_start;
  core::Frame frame, judged_frame;
  core::Image<float> depth_m;
  std::optional<GoalView> seen;  ///< In the newest image, if its labels are known.
  std::uint64_t captures = 0;
  double distance_m = 0.0;
  bool over = false;
};

}  // namespace internal

ObjectNavEnvironment::ObjectNavEnvironment(const World& world,
                                           const EnvironmentOptions& options)
    : world_(world), options_(options) {
  SEGSIM_CHECK(core::has(options.channels, core::Channels::kRgbd), "colour and depth");
  SEGSIM_CHECK(options.trial.clock.mode == ClockMode::kLockstep, "the world waits");
  SEGSIM_CHECK(options.trial.sensors == nullptr, "an exact camera alone");
}

ObjectNavEnvironment::~ObjectNavEnvironment() = default;

void ObjectNavEnvironment::reset(const Episode& episode,
                                 std::shared_ptr<const DistanceField> to_goal,
                                 core::Renderer& renderer) {
  auto next = std::make_unique<internal::RunningEpisode>(episode, world_, options_,
                                                         std::move(to_goal));
  if (running_) {  // Their memory.
    next->frame = std::move(running_->frame);
    next->judged_frame = std::move(running_->judged_frame);
    next->depth_m = std::move(running_->depth_m);
  }
  running_ = std::move(next);
  running_->distance_m = running_->judge.distance_m(running_->drive.pose());
  running_->look(renderer);
}

EnvironmentStep ObjectNavEnvironment::step(const EnvironmentAction& action,
                                           core::Renderer& renderer) {
  SEGSIM_CHECK(running_ && !running_->over, "an episode that is not over");
  internal::RunningEpisode& now = *running_;
  EnvironmentStep step;
  if (action.stop) {
    now.drive.set_command({});
    now.judge.stopped(core::StopReason::kGoalReached, now.drive.pose(),
                      now.judged_view(renderer));
    step.terminated = true;
  } else if (now.drive_by(action.commands, step)) {
    now.look(renderer);
  }
  now.over = step.terminated || step.truncated;
  if (options_.rewards) {
    step.reward = now.progress();
    if (action.stop && result().success) step.reward += options_.success_reward;
  }
  return step;
}

const core::Frame& ObjectNavEnvironment::frame() const { return running_->frame; }
const core::Image<float>& ObjectNavEnvironment::depth_m() const { return running_->depth_m; }
const Episode& ObjectNavEnvironment::episode() const { return running_->episode; }
core::Pose2 ObjectNavEnvironment::pose() const { return running_->drive.pose(); }
core::TimeNs ObjectNavEnvironment::time_ns() const { return running_->drive.time_ns(); }
bool ObjectNavEnvironment::over() const { return !running_ || running_->over; }

core::Pose2 ObjectNavEnvironment::pose_since_start() const {
  const core::Pose2& start = running_->believed_start;
  const core::Pose2 now = running_->drive.estimate();
  const double dx_m = now.x_m - start.x_m, dy_m = now.y_m - start.y_m;
  const double c = std::cos(start.yaw_rad), s = std::sin(start.yaw_rad);
  return {c * dx_m + s * dy_m, c * dy_m - s * dx_m,
          core::wrap_angle_rad(now.yaw_rad - start.yaw_rad)};
}

TrialResult ObjectNavEnvironment::result() const {
  TrialResult result;
  result.path_m = running_->drive.path_m();
  result.contacts = running_->drive.contacts();
  result.sim_s = core::seconds(running_->drive.time_ns());
  result.final_pose = running_->drive.pose();
  result.final_estimate = running_->drive.estimate();
  running_->judge.score(result.final_pose, running_->seen.value_or(internal::GoalView{}),
                        result);
  return result;
}

}  // namespace segsim::sim
