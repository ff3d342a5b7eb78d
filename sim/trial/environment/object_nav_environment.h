#pragma once

/// @file
/// A trial that somebody else's program drives, step by step: for learning. Motion, camera,
/// time limit and judging are those of run_trial() in lockstep, so that the same commands give
/// the same poses, success and SPL (docs/python_environments.md).

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "core/render.h"
#include "core/stages.h"
#include "sim/ground/world.h"
#include "sim/trial/trial.h"

namespace segsim::sim {

namespace internal {
struct RunningEpisode;
}

struct EnvironmentOptions {
  /// Lockstep; no faults, and no sensor but an exact camera.
  TrialOptions trial;
  /// What observations hold, at least kRgbd; labels are drawn for the judge in any case.
  core::Channels channels = core::Channels::kRgbd;
  bool rewards = true;  ///< Without, every reward is 0.
  double success_reward = 2.5;
};

/// One decision.
struct EnvironmentAction {
  bool stop = false;  ///< The goal is reached: ends the episode; no command counts then.
  /// Each holds for one control period; only after the last one an image is taken.
  std::span<const core::VelocityCommand> commands;
};

/// What a decision led to, true values.
struct EnvironmentStep {
  /// Metres that the way to the nearest view point became shorter, and `success_reward` for a
  /// success.
  double reward = 0.0;
  bool terminated = false;  ///< By STOP, or by a contact where that ends a trial.
  bool truncated = false;   ///< Time is over.
  bool collided = false;    ///< Something was touched in this step.
};

class ObjectNavEnvironment {
 public:
  /// @param world  Outlives it.
  /// @throws core::ContractViolation for options that are not those of an environment.
  ObjectNavEnvironment(const World& world, const EnvironmentOptions& options);
  ~ObjectNavEnvironment();
  ObjectNavEnvironment(const ObjectNavEnvironment&) = delete;
  ObjectNavEnvironment& operator=(const ObjectNavEnvironment&) = delete;

  /// Places the robot and takes the first image.
  /// @param to_goal  Distances to the view points of the episode; null: they are computed.
  /// @param renderer  Of the scene; several environments may use it in turn.
  /// @throws core::InputError if the robot does not fit where the episode starts.
  void reset(const Episode& episode, std::shared_ptr<const DistanceField> to_goal,
             core::Renderer& renderer);

  /// @pre reset() was called, and the episode is not over.
  EnvironmentStep step(const EnvironmentAction& action, core::Renderer& renderer);

  // Of the newest image.
  [[nodiscard]] const core::Frame& frame() const;
  [[nodiscard]] const core::Image<float>& depth_m() const;  ///< NaN: not measured.
  /// Where the robot believes to be, from where it believed to start: x ahead.
  [[nodiscard]] core::Pose2 pose_since_start() const;

  // What no robot knows.
  [[nodiscard]] const Episode& episode() const;
  [[nodiscard]] core::Pose2 pose() const;
  [[nodiscard]] core::TimeNs time_ns() const;
  /// As it would stand in a result if the trial ended now: outcome, success, SPL, distances,
  /// path, contacts. Pixels of the goal are known where labels are drawn, and after a STOP.
  [[nodiscard]] TrialResult result() const;
  /// Nothing more can be done in the episode.
  [[nodiscard]] bool over() const;

 private:
  const World& world_;
  EnvironmentOptions options_;
  std::unique_ptr<internal::RunningEpisode> running_;
};

}  // namespace segsim::sim
