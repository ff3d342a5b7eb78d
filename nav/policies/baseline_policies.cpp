#include "nav/policies/baseline_policies.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/random.h"
#include "nav/grid/robot_pose.h"

namespace segsim::nav {
namespace {

core::Decision stop_decision(core::StopReason reason) {
  return {{}, core::PolicyMode::kStop, reason};
}

class OraclePathPolicy final : public core::Policy {
 public:
  OraclePathPolicy(PathOracle oracle, const OraclePathOptions& options)
      : oracle_(std::move(oracle)),
        options_(options),
        swift_(options.follower),
        careful_(careful(options.follower)) {
    SEGSIM_CHECK(oracle_ != nullptr, "no oracle");
  }

  void reset(const core::ObjectGoal& goal, std::uint64_t) override {
    goal_ = goal;
    swift_.clear();
    careful_.clear();
    held_at_.reset();
    planned_ns_.reset();
    turned_rad_.reset();
    moved_ns_ = 0;
    back_until_ns_ = 0;
    moved_from_.reset();
  }

  core::Decision decide(const core::Observation& observation,
                        std::span<const core::Detection> detections) override {
    const core::Pose2 pose = pose_of(observation.T_odom_robot);
    if (turned_rad_) return look(observation, detections, pose);
    const core::TimeNs time_ns = observation.capture_time_ns;
    if (held_at_ && away_m(pose, *held_at_) > kCareful_m) held_at_.reset();
    if (!planned_ns_ || core::seconds(time_ns - *planned_ns_) >= options_.replan_period_s) {
      Path path;
      path.points_m = oracle_({pose.x_m, pose.y_m});
      if (path.points_m.empty() && !planned_ns_)
        return stop_decision(core::StopReason::kNoPath);
      if (!path.points_m.empty()) {
        swift_.set_path(path);
        careful_.set_path(path);
      }
      planned_ns_ = time_ns;
    }
    if (swift_.arrived(pose)) {
      turned_rad_ = 0.0;
      last_yaw_rad_ = pose.yaw_rad;
      return look(observation, detections, pose);
    }
    if (const auto back = back_out(pose, time_ns)) {
      return {*back, core::PolicyMode::kRecover};
    }
    PathFollower& follower = held_at_ ? careful_ : swift_;
    return {follower.follow(pose, nothing_), core::PolicyMode::kNavigate};
  }

  [[nodiscard]] core::PolicyView view() const override {
    core::PolicyView view;
    view.path_m = swift_.path().points_m;
    if (!view.path_m.empty()) view.target_m = view.path_m.back();
    return view;
  }

 private:
  static constexpr double kCareful_m = 1.5;  ///< Around a place where something held it.

  /// Keeps to the corners of the way. Where only the shortest way is left they lie at the edge
  /// of what the robot fits through, and to cut one is to be held again.
  static FollowerOptions careful(FollowerOptions options) {
    options.lookahead_m = 0.10;
    options.turn_in_place_above_rad = 0.15;
    options.max_forward_mps = std::min(options.max_forward_mps, 0.3);
    return options;
  }
  static double away_m(const core::Pose2& a, const core::Pose2& b) {
    return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m);
  }
  /// A command straight back while the robot is held by something; plans again afterwards.
  std::optional<core::VelocityCommand> back_out(const core::Pose2& pose,
                                                core::TimeNs time_ns) {
    constexpr double kMoved_m = 0.02, kTurned_rad = 0.05;
    const bool moved =
        !moved_from_ || away_m(pose, *moved_from_) > kMoved_m ||
        std::abs(core::wrap_angle_rad(pose.yaw_rad - moved_from_->yaw_rad)) > kTurned_rad;
    if (moved) {
      moved_from_ = pose;
      moved_ns_ = time_ns;
    } else if (core::seconds(time_ns - moved_ns_) >= options_.stuck_s) {
      moved_ns_ = time_ns;
      held_at_ = pose;
      back_until_ns_ = time_ns + std::llround(options_.back_s * 1e9);
    }
    if (time_ns >= back_until_ns_) return std::nullopt;
    planned_ns_ = time_ns - std::llround(options_.replan_period_s * 1e9);
    return core::VelocityCommand{-options_.back_mps, 0.0};
  }

  core::Decision look(const core::Observation& observation,
                      std::span<const core::Detection> detections, const core::Pose2& pose) {
    *turned_rad_ += core::wrap_angle_rad(pose.yaw_rad - last_yaw_rad_);
    last_yaw_rad_ = pose.yaw_rad;
    const double width = observation.intrinsics.width_px;
    const bool seen = std::any_of(
        detections.begin(), detections.end(), [&](const core::Detection& detection) {
          const double middle =
              0.5 * static_cast<double>(detection.box.x0 + detection.box.x1) / width;
          return detection.class_index == goal_.class_index &&
                 std::abs(middle - 0.5) < options_.centered_share;
        });
    if (seen || *turned_rad_ >= 2.0 * std::numbers::pi)
      return stop_decision(core::StopReason::kGoalReached);
    const double rate = 0.5 * options_.follower.max_turn_radps;
    return {{0.0, rate}, core::PolicyMode::kNavigate};
  }

  PathOracle oracle_;
  OraclePathOptions options_;
  core::ObjectGoal goal_;
  PathFollower swift_, careful_;  ///< The second one after something held the robot.
  std::optional<core::Pose2> held_at_;
  CostMap nothing_;  ///< The oracle's way needs no map: nothing is known, so nothing is in the
                     ///< way.
  std::optional<core::TimeNs> planned_ns_;
  std::optional<double> turned_rad_;
  double last_yaw_rad_ = 0.0;
  std::optional<core::Pose2> moved_from_;  ///< The last pose that counted as moved.
  core::TimeNs moved_ns_ = 0, back_until_ns_ = 0;
};

/// Actions that do not depend on what is seen.
class BlindPolicy : public core::Policy {
 public:
  explicit BlindPolicy(const DiscreteMotionOptions& options) : executor_(options) {}
  void reset(const core::ObjectGoal&, std::uint64_t seed) override {
    executor_.reset();
    last_ns_.reset();
    stopped_ = false;
    begin(seed);
  }
  core::Decision decide(const core::Observation& observation,
                        std::span<const core::Detection>) override {
    if (stopped_) return stop_decision(reason());
    const core::Pose2 pose = pose_of(observation.T_odom_robot);
    const core::TimeNs time_ns = observation.capture_time_ns;
    const double period_s = last_ns_ ? core::seconds(time_ns - *last_ns_) : 0.1;
    last_ns_ = time_ns;
    core::VelocityCommand command = executor_.command(pose, time_ns, period_s);
    if (!executor_.busy()) {
      const DiscreteAction action = next();
      stopped_ = action == DiscreteAction::kStop;
      if (stopped_) return stop_decision(reason());
      executor_.start(action, pose, time_ns);
      command = executor_.command(pose, time_ns, period_s);
    }
    return {command, core::PolicyMode::kExplore};
  }
  [[nodiscard]] core::PolicyView view() const override { return {}; }

 protected:
  virtual void begin(std::uint64_t seed) = 0;
  virtual DiscreteAction next() = 0;
  [[nodiscard]] virtual core::StopReason reason() const = 0;

 private:
  DiscreteExecutor executor_;
  std::optional<core::TimeNs> last_ns_;
  bool stopped_ = false;
};

class RandomPolicy final : public BlindPolicy {
 public:
  explicit RandomPolicy(const RandomPolicyOptions& options)
      : BlindPolicy(options.actions), options_(options) {}

 private:
  void begin(std::uint64_t seed) override {
    random_ = core::RandomStream(seed, "random_policy");
  }
  DiscreteAction next() override {
    if (random_.chance(options_.stop_chance)) return DiscreteAction::kStop;
    if (random_.chance(options_.forward_chance)) return DiscreteAction::kForward;
    return random_.chance(0.5) ? DiscreteAction::kTurnLeft : DiscreteAction::kTurnRight;
  }
  [[nodiscard]] core::StopReason reason() const override {
    return core::StopReason::kRandomStop;
  }

  RandomPolicyOptions options_;
  core::RandomStream random_{0, "random_policy"};
};

class ScriptPolicy final : public BlindPolicy {
 public:
  ScriptPolicy(std::vector<DiscreteAction> actions, const DiscreteMotionOptions& options)
      : BlindPolicy(options), actions_(std::move(actions)) {}

 private:
  void begin(std::uint64_t) override { at_ = 0; }
  DiscreteAction next() override {
    return at_ < actions_.size() ? actions_[at_++] : DiscreteAction::kStop;
  }
  [[nodiscard]] core::StopReason reason() const override {
    return core::StopReason::kScriptEnd;
  }

  std::vector<DiscreteAction> actions_;
  std::size_t at_ = 0;
};

}  // namespace

std::unique_ptr<core::Policy> make_oracle_path_policy(PathOracle oracle,
                                                      const OraclePathOptions& options) {
  return std::make_unique<OraclePathPolicy>(std::move(oracle), options);
}

std::unique_ptr<core::Policy> make_random_policy(const RandomPolicyOptions& options) {
  return std::make_unique<RandomPolicy>(options);
}

std::unique_ptr<core::Policy> make_script_policy(std::vector<DiscreteAction> actions,
                                                 const DiscreteMotionOptions& options) {
  return std::make_unique<ScriptPolicy>(std::move(actions), options);
}

}  // namespace segsim::nav
