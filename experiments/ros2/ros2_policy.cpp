#include "experiments/ros2/ros2_policy.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "core/error.h"
#include "core/formatted.h"
#include "experiments/support/stop_signal.h"

namespace segsim::experiments::ros2 {
namespace {

/// Of `commands: newest`: an older command no longer counts, as a robot's base has it.
constexpr std::int64_t kCommandLife_ns = 500'000'000;
/// An image may be lost while its reader is still being found, so the first one of an episode
/// is published again after that.
constexpr double kAgain_s = 0.5;
constexpr double kLook_s = 0.05;  ///< Between two looks at who is there.

std::int64_t wall_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// Wall time that is left.
class Deadline {
 public:
  explicit Deadline(double after_s)
      : end_ns_(wall_ns() + static_cast<std::int64_t>(after_s * 1e9)) {}
  [[nodiscard]] double left_s() const {
    return std::max(0.0, static_cast<double>(end_ns_ - wall_ns()) * 1e-9);
  }
  [[nodiscard]] bool over() const { return wall_ns() >= end_ns_; }

 private:
  std::int64_t end_ns_;
};

}  // namespace

Ros2Policy::Ros2Policy(std::shared_ptr<RobotNode> robot, nav::Ros2Settings settings,
                       std::vector<std::string> class_names)
    : robot_(std::move(robot)),
      settings_(std::move(settings)),
      class_names_(std::move(class_names)) {}

void Ros2Policy::reset(const core::ObjectGoal& goal, std::uint64_t /*seed*/) {
  order_ = {};
  order_wall_ns_ = 0;
  answered_ = false;
  robot_->begin(goal, class_names_, sensors_);
  if (map_) robot_->publish(*map_);
  const Deadline deadline(settings_.start_s);
  while (!robot_->has_pilot()) {
    support::StopOnSignal::check();
    if (deadline.over()) {
      throw core::InputError::expected(robot_->name(),
                                       "a publisher of " + robot_->command_topic() +
                                           " within " + core::print("%g", settings_.start_s) +
                                           " s",
                                       "none");
    }
    robot_->wait(kLook_s);
  }
}

core::Decision Ros2Policy::decide(const core::Observation& observation,
                                  std::span<const core::Detection> detections) {
  if (settings_.waits) robot_->drop_velocities();  // They answer older images.
  if (!settings_.detections) detections = {};
  robot_->publish(observation, detections);
  order_ = settings_.waits ? await_order(observation, detections) : newest_order();
  core::Decision decision;
  decision.command = order_.command;
  decision.stop = order_.stop;
  if (decision.stop) decision.mode = core::PolicyMode::kStop;
  return decision;
}

RobotOrder Ros2Policy::await_order(const core::Observation& observation,
                                   std::span<const core::Detection> detections) {
  const Deadline deadline(settings_.answer_s);
  Deadline again(kAgain_s);
  for (;;) {
    if (const auto order = robot_->take_order()) {
      answered_ = true;
      return *order;
    }
    support::StopOnSignal::check();
    if (deadline.over()) break;
    if (!answered_ && again.over()) {
      robot_->publish(observation, detections);
      again = Deadline(kAgain_s);
    }
    robot_->wait(std::min(deadline.left_s(), answered_ ? kAgain_s : again.left_s()));
  }
  throw core::InputError::expected(
      robot_->name(),
      "a command on " + robot_->command_topic() + " within " +
          core::print("%g", settings_.answer_s) + " s of the image at " +
          core::print("%.3f", core::seconds(observation.capture_time_ns)) + " s",
      "none");
}

RobotOrder Ros2Policy::newest_order() {
  support::StopOnSignal::check();
  if (const auto order = robot_->take_order()) {
    order_wall_ns_ = wall_ns();
    return *order;
  }
  return wall_ns() - order_wall_ns_ <= kCommandLife_ns ? order_ : RobotOrder{};
}

}  // namespace segsim::experiments::ros2
