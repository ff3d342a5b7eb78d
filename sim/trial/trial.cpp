#include "sim/trial/trial.h"

#include <cmath>

#include "sim/time/schedule.h"
#include "sim/trial/internal/camera_trigger.h"
#include "sim/trial/internal/command_queue.h"
#include "sim/trial/internal/robot_computer.h"
#include "sim/trial/internal/trial_drive.h"
#include "sim/trial/internal/trial_eye.h"
#include "sim/trial/internal/trial_judge.h"
#include "sim/trial/internal/trial_recorder.h"

namespace segsim::sim {
namespace {

using internal::BaseOrder;
using internal::Capture;
using internal::GoalView;
using internal::wall_ns;

/// A tick that comes later than that is an overrun: below, it is the system's timer.
constexpr core::TimeNs kLate_ns = 1'000'000;

core::TimeNs control_period_ns(const TrialOptions& options) {
  return std::llround(options.control_period_s * 1e9);
}

SensorRate camera_rate(const TrialOptions& options) {
  SensorRate rate = options.clock.camera;
  if (rate.period_ns == 0) rate.period_ns = control_period_ns(options);
  return rate;
}

/// One trial. What returns a bool returns false once the trial is over.
class Trial {
 public:
  explicit Trial(const TrialParts& parts)
      : options_(parts.options),
        policy_(parts.policy),
        readings_(parts.readings),
        paced_(parts.options.clock.mode == ClockMode::kRealtime && parts.drive == nullptr),
        period_ns_(control_period_ns(parts.options)),
        drive_(parts.episode, parts.options, parts.world, parts.robot, parts.drive),
        camera_(camera_rate(parts.options), parts.episode.seed,
                parts.options.faults.frame_drops),
        eye_(parts),
        computer_(parts.options, parts.episode.seed, eye_),
        commands_(computer_.budget()),
        judge_(parts.episode, parts.options, parts.world),
        recorder_(eye_.goal().class_index, parts.policy, parts.observer) {
    policy_.reset(eye_.goal(), parts.episode.seed);
  }

  TrialResult run() {
    for (int tick = 0; judge_.in_time(tick * period_ns_); ++tick) {
      const core::TimeNs now_ns = tick * period_ns_;
      begin_tick(now_ns);
      if (!advance_to(now_ns)) break;
      const bool goes_on = decide(tick, now_ns);
      record(now_ns);
      if (!goes_on) break;
      if (decision_.stop) {
        await_stop(tick, now_ns);
        break;
      }
    }
    return result();
  }

 private:
  /// Drives, takes images and computes up to that time.
  bool advance_to(core::TimeNs time_ns) {
    while (camera_.next_ns() <= time_ns) {
      const core::TimeNs image_ns = camera_.next_ns();
      // Only what comes before: a server that becomes free at the moment of the exposure
      // chooses among all images, this one too.
      if (!compute(image_ns - 1) || !drive(image_ns)) return false;
      sense(image_ns);
    }
    return compute(time_ns) && drive(time_ns);
  }

  bool drive(core::TimeNs time_ns) {
    if (drive_.drive_to(time_ns)) return true;
    judge_.collided();
    return false;
  }

  /// Takes the image that is due now, unless a fault does.
  void sense(core::TimeNs now_ns) {
    if (!camera_.release()) return eye_.skip();
    computer_.take_in(eye_.take(now_ns, drive_.pose(), drive_.estimate(), drive_.velocity()));
  }

  /// Computes up to that time; drives as far as the last command that came into effect.
  bool compute(core::TimeNs time_ns) {
    for (const Schedule::Effect& effect : computer_.compute_until(time_ns)) {
      if (!drive(effect.time_ns)) return false;
      if (!obey(commands_.arrive(effect.tick, effect.time_ns))) return false;
    }
    return true;
  }

  /// Decides, if there is something new; else the base goes on as it does.
  bool decide(int tick, core::TimeNs now_ns) {
    decided_now_ = take_news(now_ns);
    if (decided_now_) {
      ask_policy(static_cast<std::uint64_t>(tick), now_ns);
      // What takes no time happens within the tick.
      if (!compute(now_ns)) return false;
    } else {
      obey(commands_.repeat());
    }
    return eye_.in_use() == nullptr || check_age(now_ns);
  }

  void record(core::TimeNs now_ns) {
    TickRecord tick;
    tick.time_ns = now_ns;
    tick.pose = drive_.pose();
    tick.estimate = drive_.estimate();
    tick.in_contact = drive_.in_contact();
    tick.fresh = decided_now_;
    tick.command = decision_.command;
    tick.mode = decision_.mode;
    const Capture* newest = eye_.newest();
    const bool in_view = newest != nullptr && judge_.sees_goal(newest->goal);
    recorder_.add(tick, {newest, in_view, eye_.in_use()});
  }

  void begin_tick(core::TimeNs now_ns) {
    drive_.begin_tick();
    if (paced_ && pacer_.wait_until(now_ns) > kLate_ns) recorder_.overrun();
  }

  /// Whether a new image is there and the policy is free for it.
  bool take_news(core::TimeNs now_ns) {
    if (eye_.ready() == nullptr || computer_.deciding()) return false;
    if (commands_.refuses(now_ns - eye_.ready()->time_ns)) {
      eye_.discard_ready();
      return false;
    }
    return true;
  }

  void ask_policy(std::uint64_t tick, core::TimeNs now_ns) {
    Capture& capture = eye_.use_ready();
    const std::vector<core::Detection>& detections = eye_.detections_of(capture);
    const core::Pose2 pose = drive_.estimate();
    if (readings_ && drive_.sensor_log() != nullptr) readings_(*drive_.sensor_log(), now_ns);
    const bool at_use = options_.clock.registration == Registration::kUse;
    const core::TimeNs start_ns = wall_ns();
    decision_ =
        policy_.decide(eye_.observation(capture, at_use ? &pose : nullptr), detections);
    const core::TimeNs took_ns = wall_ns() - start_ns;
    policy_sum_ns_ += took_ns;
    ++decisions_;
    if (decision_.stop) decision_.command = {};
    commands_.send(tick, decision_, capture.time_ns, now_ns);
    computer_.decided(now_ns, tick, took_ns);
  }

  bool check_age(core::TimeNs now_ns) {
    return obey(commands_.check_age(now_ns - eye_.in_use()->time_ns));
  }

  /// Tells the base what the command queue says.
  bool obey(const BaseOrder& order) {
    switch (order.kind) {
      case BaseOrder::Kind::kNothing:
        return true;
      case BaseOrder::Kind::kDrive:
        drive_.set_command(order.command);
        return true;
      case BaseOrder::Kind::kSendAgain:
        drive_.send_again();
        return true;
      case BaseOrder::Kind::kStop:
        drive_.set_command({});
        judge_.stopped(*order.stop, drive_.pose(), view_now());
        return false;
      case BaseOrder::Kind::kAbort:
        drive_.set_command({});
        judge_.aborted();
        return false;
    }
    return true;
  }

  /// What the camera sees now, also if no image is due.
  GoalView view_now() {
    const Capture* newest = eye_.newest();
    const bool just_taken = newest != nullptr && newest->time_ns == drive_.time_ns();
    return just_taken ? newest->goal : eye_.look(drive_.pose());
  }

  /// The robot goes on until its STOP reaches the wheels: tick for tick as before, but nothing
  /// is decided any more.
  void await_stop(int tick, core::TimeNs now_ns) {
    while (commands_.on_its_way(static_cast<std::uint64_t>(tick))) {
      now_ns += period_ns_;
      if (!advance_to(now_ns)) return;
      obey(commands_.repeat());
      if (!check_age(now_ns)) return;
    }
  }

  TrialResult result() {
    TrialResult result;
    computer_.report(result.timing);
    result.timing.end_to_end = commands_.end_to_end();
    result.timing.span_ns = drive_.time_ns();
    result.trace = computer_.trace();
    recorder_.report(result);
    eye_.report(result);
    result.frames_dropped = camera_.dropped();
    result.policy_ms = decisions_ == 0 ? 0.0 : ms_from_ns(policy_sum_ns_) / decisions_;
    result.final_view = policy_.view();
    drive_.report(result);
    result.sensors.camera = eye_.take_validity();
    const Capture* newest = eye_.newest();
    judge_.score(drive_.pose(), newest != nullptr ? newest->goal : GoalView{}, result);
    return result;
  }

  const TrialOptions& options_;
  core::Policy& policy_;
  const ReadingsObserver& readings_;
  bool paced_;  ///< By the wall clock; another simulator's clock paces by itself.
  core::TimeNs period_ns_;
  internal::TrialDrive drive_;
  internal::CameraTrigger camera_;
  internal::TrialEye eye_;
  internal::RobotComputer computer_;
  internal::CommandQueue commands_;
  internal::TrialJudge judge_;
  internal::TrialRecorder recorder_;
  Pacer pacer_;
  core::Decision decision_{{}, core::PolicyMode::kInitialize};  ///< The newest.
  bool decided_now_ = false;                                    ///< At this tick.
  core::TimeNs policy_sum_ns_ = 0;                              ///< Wall time.
  int decisions_ = 0;
};

}  // namespace

TrialResult run_trial(const TrialParts& parts) {
  const core::TimeNs start_ns = wall_ns();
  TrialResult result = Trial(parts).run();
  result.wall_s = core::seconds(wall_ns() - start_ns);
  return result;
}

}  // namespace segsim::sim
