#pragma once

/// @file
/// The driver of a scripted trial: a policy that does one step after the other. Like every
/// policy it sees images and the robot's own estimate of its pose, never the true one; its
/// clock is the time of the images.

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <glm/vec2.hpp>

#include "core/stages.h"
#include "experiments/scripted_trials/scripted_trial.h"
#include "nav/motion/path_follower.h"
#include "nav/policies/baseline_policies.h"
#include "sim/ground/robot.h"

namespace segsim::experiments::scripted_trials {

enum class StepEnd : std::uint8_t { kDone, kTimedOut, kNoWay, kNotFound };
[[nodiscard]] const char* to_string(StepEnd end);

/// How one step went, by the robot's clock and estimate.
struct StepOutcome {
  int step = 0;                            ///< Into the script.
  core::TimeNs begin_ns = 0, end_ns = -1;  ///< -1: it was not finished.
  std::optional<StepEnd> end;              ///< None: the trial ended before.
  core::Pose2 begin, finish;
  std::optional<core::StopReason> stop;  ///< Why the policy of a kGoto or kFind stopped.
};

/// Why the step ended as it did, in one word; "" if there is nothing to say.
[[nodiscard]] std::string reason_of(const StepOutcome& step);

/// What the driver needs of the world; Odom equals World as long as the robot knows its pose.
struct DriverContext {
  sim::RobotModel robot;
  /// Of each step its places in World (empty where it has none).
  std::vector<std::vector<glm::dvec2>> places_m;
  /// A way that the robot fits through, to the place.
  std::function<nav::PathOracle(const glm::dvec2& goal_m)> way_to;
  /// The policy of a kFind step, and the index of its category among the detector's classes.
  std::function<std::unique_ptr<core::Policy>(const ScriptStep&)> searcher;
  std::function<int(const std::string& category)> class_index;
};

class ScriptDriver final : public core::Policy {
 public:
  /// @param steps  Outlive the driver.
  ScriptDriver(const std::vector<ScriptStep>& steps, DriverContext context);
  ~ScriptDriver() override;

  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override;
  /// Stop reasons: kScriptEnd; kStepFailed after a step that was not done.
  [[nodiscard]] core::Decision decide(const core::Observation& observation,
                                      std::span<const core::Detection> detections) override;
  [[nodiscard]] core::PolicyView view() const override;

  /// Of the steps that were begun, in order.
  [[nodiscard]] const std::vector<StepOutcome>& records() const { return records_; }

 private:
  /// What moves the robot in one step.
  class Motion;
  class Drive;
  class Follow;
  class Spin;
  class Timed;
  class Search;
  [[nodiscard]] std::unique_ptr<Motion> begin(std::size_t step) const;

  const std::vector<ScriptStep>& steps_;
  DriverContext context_;
  std::uint64_t seed_ = 0;
  std::vector<StepOutcome> records_;
  std::unique_ptr<Motion> motion_;
  bool failed_ = false;
};

}  // namespace segsim::experiments::scripted_trials
