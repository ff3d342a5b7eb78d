#include "experiments/scripted_trials/script_driver.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <glm/geometric.hpp>

#include "core/random.h"
#include "nav/behaviours/fitted_options.h"

namespace segsim::experiments::scripted_trials {
namespace {

constexpr double kAtRest_m = 0.005, kAtRest_rad = 0.01;
constexpr double kLongestBraking_s = 3.0;

core::Pose2 pose_of(const core::Observation& seen) {
  const glm::dvec3& p = seen.T_odom_robot.translation_m();
  const glm::dvec3 ahead = seen.T_odom_robot.rotation() * glm::dvec3(1.0, 0.0, 0.0);
  return {p.x, p.y, std::atan2(ahead.y, ahead.x)};
}

glm::dvec2 position_of(const core::Pose2& pose) { return {pose.x_m, pose.y_m}; }

nav::FollowerOptions follower_options(const ScriptStep& step, const sim::RobotModel& robot) {
  nav::FollowerOptions options = nav::OraclePathOptions{}.follower;
  options.max_forward_mps = step.speed_mps;
  options.goal_tolerance_m = std::min(options.goal_tolerance_m, 0.8 * step.tolerance_m);
  return nav::fitted(options, robot);
}

}  // namespace

const char* to_string(StepEnd end) {
  constexpr const char* kNames[] = {"done", "timed_out", "no_way", "not_found"};
  return kNames[static_cast<std::size_t>(end)];
}

std::string reason_of(const StepOutcome& step) {
  // The driver of a goto thinks that it has arrived, and the place is farther than tolerated.
  const bool too_early =
      step.end == StepEnd::kNoWay && step.stop == core::StopReason::kGoalReached;
  return too_early ? "ends_before_tolerance" : core::to_string(step.stop);
}

class ScriptDriver::Motion {
 public:
  virtual ~Motion() = default;
  /// A command, or how the step ended.
  struct Answer {
    core::Decision decision;
    std::optional<StepEnd> end{};
    std::optional<core::StopReason> stop{};
  };
  [[nodiscard]] virtual Answer advance(const core::Observation& seen,
                                       std::span<const core::Detection> detections) = 0;
  [[nodiscard]] virtual core::PolicyView view() const { return {}; }

 protected:
  static Answer go(double forward_mps, double turn_radps) {
    return {{{forward_mps, turn_radps}, core::PolicyMode::kNavigate}};
  }
  static Answer ended(StepEnd end, std::optional<core::StopReason> stop = {}) {
    return {{}, end, stop};
  }
};

/// goto: the simulator's way to the place, driven as the oracle-path policy drives it.
class ScriptDriver::Drive final : public Motion {
 public:
  Drive(const ScriptStep& step, const glm::dvec2& goal_m, nav::PathOracle way,
        const sim::RobotModel& robot)
      : goal_m_(goal_m), tolerance_m_(step.tolerance_m) {
    nav::OraclePathOptions options;
    options.follower = follower_options(step, robot);
    policy_ = nav::make_oracle_path_policy(std::move(way), options);
    policy_->reset({}, 0);
  }
  Answer advance(const core::Observation& seen, std::span<const core::Detection>) override {
    if (glm::distance(position_of(pose_of(seen)), goal_m_) <= tolerance_m_) {
      return ended(StepEnd::kDone);
    }
    // Without detections it never takes anything for its goal.
    core::Decision decision = policy_->decide(seen, {});
    if (decision.stop) return ended(StepEnd::kNoWay, decision.stop);
    return {decision};
  }
  [[nodiscard]] core::PolicyView view() const override { return policy_->view(); }

 private:
  glm::dvec2 goal_m_;
  double tolerance_m_;
  std::unique_ptr<core::Policy> policy_;
};

/// follow: along the given corners, wherever they lead. Progress only grows, so loops and
/// crossings are driven as drawn.
class ScriptDriver::Follow final : public Motion {
 public:
  Follow(const ScriptStep& step, std::vector<glm::dvec2> corners_m,
         const sim::RobotModel& robot)
      : corners_m_(std::move(corners_m)),
        options_(follower_options(step, robot)),
        tolerance_m_(step.tolerance_m),
        follower_(options_) {}

  Answer advance(const core::Observation& seen, std::span<const core::Detection>) override {
    const core::Pose2 pose = pose_of(seen);
    if (!follower_.has_path()) begin(position_of(pose));
    find_progress(position_of(pose));
    const double left_m = length_m() - progress_m_;
    if (left_m <= tolerance_m_) return ended(StepEnd::kDone);
    core::VelocityCommand command = follower_.follow(pose, nothing_);
    const double braking_mps = std::sqrt(2.0 * options_.max_accel_mps2 * left_m);
    if (command.forward_mps > braking_mps) {
      command.turn_radps *= braking_mps / command.forward_mps;
      command.forward_mps = braking_mps;
    }
    return go(command.forward_mps, command.turn_radps);
  }
  [[nodiscard]] core::PolicyView view() const override {
    core::PolicyView view;
    view.path_m = corners_m_;
    return view;
  }

 private:
  void begin(const glm::dvec2& from_m) {
    corners_m_.insert(corners_m_.begin(), from_m);
    along_m_ = {0.0};
    for (std::size_t k = 1; k < corners_m_.size(); ++k) {
      along_m_.push_back(along_m_.back() + glm::distance(corners_m_[k - 1], corners_m_[k]));
    }
    // The follower stops near the last point, and the end of a loop is where it begins: its
    // path leads on, so far that nothing else comes near its end.
    nav::Path path;
    path.points_m = corners_m_;
    const glm::dvec2 last = corners_m_.back() - corners_m_[corners_m_.size() - 2];
    const double length = glm::length(last);
    constexpr double kBeyond_m = 1e4;
    path.points_m.push_back(corners_m_.back() +
                            (length > 0.0 ? last / length : glm::dvec2(1.0, 0.0)) * kBeyond_m);
    follower_.set_path(path);
  }
  [[nodiscard]] double length_m() const { return along_m_.back(); }

  /// Nearest point of the next metre of the path.
  void find_progress(const glm::dvec2& p_m) {
    constexpr double kAhead_m = 1.0;
    double best_m = 1e18;
    const double from_m = progress_m_;
    for (std::size_t k = 0; k + 1 < corners_m_.size(); ++k) {
      const double segment_m = along_m_[k + 1] - along_m_[k];
      if (along_m_[k + 1] < from_m || along_m_[k] > from_m + kAhead_m || segment_m <= 0.0) {
        continue;
      }
      const glm::dvec2 direction = (corners_m_[k + 1] - corners_m_[k]) / segment_m;
      const double low = std::max(0.0, from_m - along_m_[k]);
      const double high = std::min(segment_m, from_m + kAhead_m - along_m_[k]);
      if (low > high) continue;
      const double t = std::clamp(glm::dot(p_m - corners_m_[k], direction), low, high);
      const double distance_m = glm::distance(p_m, corners_m_[k] + t * direction);
      if (distance_m < best_m - 1e-9) {
        best_m = distance_m;
        progress_m_ = along_m_[k] + t;
      }
    }
  }

  std::vector<glm::dvec2> corners_m_;
  std::vector<double> along_m_;  ///< Length up to each corner.
  nav::FollowerOptions options_;
  double tolerance_m_;
  nav::PathFollower follower_;
  nav::CostMap nothing_;  ///< A drawn path is followed blindly.
  double progress_m_ = 0.0;
};

class ScriptDriver::Spin final : public Motion {
 public:
  Spin(const ScriptStep& step, const sim::RobotModel& robot)
      : left_rad_(step.angle_rad),
        rate_radps_(std::min(step.rate_radps, robot.max_turn_radps)) {}
  Answer advance(const core::Observation& seen, std::span<const core::Detection>) override {
    constexpr double kGain_per_s = 2.0, kSlowest_radps = 0.12;
    constexpr double kTolerance_rad = 1.5 * std::numbers::pi / 180.0;
    const double yaw_rad = pose_of(seen).yaw_rad;
    if (yaw_rad_) left_rad_ -= core::wrap_angle_rad(yaw_rad - *yaw_rad_);
    yaw_rad_ = yaw_rad;
    if (std::abs(left_rad_) <= kTolerance_rad) return ended(StepEnd::kDone);
    const double rate = std::clamp(kGain_per_s * std::abs(left_rad_), kSlowest_radps,
                                   std::max(kSlowest_radps, rate_radps_));
    return go(0.0, std::copysign(rate, left_rad_));
  }

 private:
  double left_rad_, rate_radps_;
  std::optional<double> yaw_rad_;
};

/// cmd and hold: one command for some time.
class ScriptDriver::Timed final : public Motion {
 public:
  explicit Timed(const ScriptStep& step)
      : command_(step.command), for_ns_(std::llround(step.for_s * 1e9)) {}
  Answer advance(const core::Observation& seen, std::span<const core::Detection>) override {
    if (!begin_ns_) begin_ns_ = seen.capture_time_ns;
    if (seen.capture_time_ns - *begin_ns_ >= for_ns_) return ended(StepEnd::kDone);
    return go(command_.forward_mps, command_.turn_radps);
  }

 private:
  core::VelocityCommand command_;
  core::TimeNs for_ns_;
  std::optional<core::TimeNs> begin_ns_;
};

/// find: a search policy until it says STOP; then the robot comes to rest, so that the step
/// ends where it is judged.
class ScriptDriver::Search final : public Motion {
 public:
  Search(std::unique_ptr<core::Policy> policy, int max_steps)
      : policy_(std::move(policy)), steps_left_(max_steps) {}
  Answer advance(const core::Observation& seen,
                 std::span<const core::Detection> detections) override {
    if (stopped_ns_) return come_to_rest(seen);
    if (steps_left_-- == 0) return ended(StepEnd::kTimedOut);
    core::Decision decision = policy_->decide(seen, detections);
    if (!decision.stop) return {decision};
    stop_ = decision.stop;
    stopped_ns_ = seen.capture_time_ns;
    last_ = pose_of(seen);
    return go(0.0, 0.0);
  }
  [[nodiscard]] core::PolicyView view() const override { return policy_->view(); }

 private:
  Answer come_to_rest(const core::Observation& seen) {
    const core::Pose2 pose = pose_of(seen);
    const bool rests =
        glm::distance(position_of(pose), position_of(last_)) < kAtRest_m &&
        std::abs(core::wrap_angle_rad(pose.yaw_rad - last_.yaw_rad)) < kAtRest_rad;
    last_ = pose;
    const double waited_s = core::seconds(seen.capture_time_ns - *stopped_ns_);
    if (!rests && waited_s < kLongestBraking_s) return go(0.0, 0.0);
    const bool found = stop_ == core::StopReason::kGoalReached;
    return ended(found ? StepEnd::kDone : StepEnd::kNotFound, stop_);
  }

  std::unique_ptr<core::Policy> policy_;
  int steps_left_;
  std::optional<core::TimeNs> stopped_ns_;
  std::optional<core::StopReason> stop_;
  core::Pose2 last_;
};

ScriptDriver::ScriptDriver(const std::vector<ScriptStep>& steps, DriverContext context)
    : steps_(steps), context_(std::move(context)) {}
ScriptDriver::~ScriptDriver() = default;

void ScriptDriver::reset(const core::ObjectGoal&, std::uint64_t seed) {
  seed_ = seed;
  records_.clear();
  motion_.reset();
  failed_ = false;
}

std::unique_ptr<ScriptDriver::Motion> ScriptDriver::begin(std::size_t index) const {
  const ScriptStep& step = steps_[index];
  const std::vector<glm::dvec2>& places_m = context_.places_m[index];
  switch (step.kind) {
    case StepKind::kGoto:
      return std::make_unique<Drive>(step, places_m[0], context_.way_to(places_m[0]),
                                     context_.robot);
    case StepKind::kFollow:
      return std::make_unique<Follow>(step, places_m, context_.robot);
    case StepKind::kSpin:
      return std::make_unique<Spin>(step, context_.robot);
    case StepKind::kCmd:
    case StepKind::kHold:
      return std::make_unique<Timed>(step);
    case StepKind::kFind: {
      std::unique_ptr<core::Policy> policy = context_.searcher(step);
      policy->reset({step.category, context_.class_index(step.category)},
                    core::hash64("step " + std::to_string(index), seed_));
      return std::make_unique<Search>(std::move(policy), step.max_steps);
    }
  }
  return nullptr;
}

core::Decision ScriptDriver::decide(const core::Observation& seen,
                                    std::span<const core::Detection> detections) {
  const core::Decision stop{{}, core::PolicyMode::kStop, core::StopReason::kScriptEnd};
  // A step that ends gives way to the next one at once.
  while (!failed_) {
    if (motion_ == nullptr) {
      if (records_.size() == steps_.size()) return stop;
      motion_ = begin(records_.size());
      StepOutcome record;
      record.step = static_cast<int>(records_.size());
      record.begin_ns = seen.capture_time_ns;
      record.begin = pose_of(seen);
      records_.push_back(record);
    }
    StepOutcome& record = records_.back();
    const ScriptStep& step = steps_[static_cast<std::size_t>(record.step)];
    Motion::Answer answer = motion_->advance(seen, detections);
    const double lasted_s = core::seconds(seen.capture_time_ns - record.begin_ns);
    if (!answer.end && step.timeout_s > 0.0 && lasted_s >= step.timeout_s) {
      answer.end = StepEnd::kTimedOut;
    }
    if (!answer.end) return answer.decision;
    record.end = answer.end;
    record.end_ns = seen.capture_time_ns;
    record.finish = pose_of(seen);
    record.stop = answer.stop;
    failed_ = *answer.end != StepEnd::kDone;
    motion_.reset();
  }
  core::Decision failed = stop;
  failed.stop = core::StopReason::kStepFailed;
  return failed;
}

core::PolicyView ScriptDriver::view() const {
  return motion_ != nullptr ? motion_->view() : core::PolicyView{};
}

}  // namespace segsim::experiments::scripted_trials
