#include "sim/trial/trial.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string_view>

#include "core/random.h"
#include "sim/time/schedule.h"
#include "sim/trial/internal/trial_drive.h"
#include "sim/trial/internal/trial_eye.h"
#include "sim/trial/metrics.h"

namespace segsim::sim {
namespace {

using internal::Capture;
using internal::GoalView;
using internal::TrialDrive;
using internal::TrialEye;
using internal::wall_ns;

/// A tick that comes later than that is an overrun: below, it is the system's timer.
constexpr core::TimeNs kLate_ns = 1'000'000;

std::uint64_t chain_hash(std::uint64_t previous, const TickRecord& record) {
  const auto quantised = [](double value) { return std::llround(value * 1e6); };
  const std::array<std::int64_t, 9> state = {
      record.time_ns,
      quantised(record.pose.x_m),
      quantised(record.pose.y_m),
      quantised(record.pose.yaw_rad),
      quantised(record.command.forward_mps),
      quantised(record.command.turn_radps),
      static_cast<std::int64_t>(record.mode),
      record.capture_index,
      static_cast<std::int64_t>(record.detections_hash)};
  // Bytes in a fixed order, so that the hash is the same on every machine.
  std::array<char, 8 * state.size()> bytes{};
  for (std::size_t k = 0; k < bytes.size(); ++k) {
    const auto word = static_cast<std::uint64_t>(state[k / 8]);
    bytes[k] = static_cast<char>((word >> (8 * (k % 8))) & 0xffU);
  }
  return core::hash64(std::string_view(bytes.data(), bytes.size()), previous);
}

/// What a STOP amounts to. Near is strict: at exactly the success distance it fails.
Outcome classify_stop(const std::string& reason, double distance_m, bool visible,
                      const TrialOptions& options) {
  if (reason != "goal_reached") return Outcome::kGaveUp;
  if (!(distance_m < options.success_distance_m)) return Outcome::kStoppedFar;
  return visible || !options.require_visible ? Outcome::kSuccess : Outcome::kNotVisible;
}

/// One trial: what drives, what sees, what computes, and what decides.
class Loop {
 public:
  Loop(const Episode& episode, const TrialOptions& options, const World& world,
       const RobotModel& robot, core::Renderer& renderer, core::Detector& detector,
       core::Policy& policy, GroundTruthSink* truth, const TickObserver& observer)
      : episode_(episode),
        options_(options),
        policy_(policy),
        observer_(observer),
        drive_(episode, options, world, robot),
        eye_(episode, options, world, renderer, detector, truth),
        budget_(options.clock.played_budget()),
        schedule_(budget_, [this](const StageBudget& stage,
                                  std::uint64_t index) { return work(stage, index); }),
        period_ns_(std::llround(options.control_period_s * 1e9)),
        camera_(options.clock.camera),
        frames_to_drop_(options.faults.frame_drops) {
    // A scripted drive has no goal, and no use for the distances to it.
    if (!episode.view_points_m.empty()) {
      to_goal_.emplace(world.distance_to(episode.view_points_m));
    }
    if (camera_.period_ns == 0) camera_.period_ns = period_ns_;
    result_.timing.end_to_end.name = "end_to_end";
    result_.timing.end_to_end.deadline_ns = budget_.end_to_end_deadline_ns;
    policy_.reset(eye_.goal(), episode.seed);
  }

  TrialResult run() {
    const core::TimeNs limit_ns = std::llround(options_.time_limit_s * 1e9);
    // A STOP at exactly the time limit still counts.
    for (int tick = 0; tick * period_ns_ <= limit_ns; ++tick) {
      const core::TimeNs now_ns = tick * period_ns_;
      if (options_.clock.mode == ClockMode::kRealtime &&
          pacer_.wait_until(now_ns) > kLate_ns) {
        ++result_.timing.overruns;
      }
      drive_.begin_tick();
      if (!play_until(now_ns)) break;
      if (!one_tick(tick, now_ns)) break;
    }
    finish();
    return std::move(result_);
  }

 private:
  /// Duration of one job that starts now; runs what this program does for it.
  core::TimeNs work(const StageBudget& stage, std::uint64_t index) {
    core::TimeNs measured_ns = 0;
    int items = 0;
    if (stage.name == "policy") {
      measured_ns = policy_ns_;
    } else if (stage.name != "actuate") {
      Capture& capture = eye_.at(index);
      if (stage.name == "detect") {
        eye_.detect(capture);
        measured_ns = capture.detect_ns;
      } else if (stage.name == "render") {
        measured_ns = capture.render_ns;
      }
      items = static_cast<int>(capture.detections.size());
    }
    // In both modes that measure. In realtime a factor makes the robot's computer slower than
    // this one, and the world still keeps to the wall clock.
    const auto scaled_ns = static_cast<core::TimeNs>(static_cast<double>(measured_ns) *
                                                     options_.clock.measured_scale);
    const core::TimeNs duration_ns =
        stage.duration.draw(stage.name, episode_.seed, index, items, scaled_ns) +
        options_.faults.added_ns(stage.name, schedule_.job_begins_ns());
    result_.trace.add(stage.name, index, duration_ns);
    return duration_ns;
  }

  /// Drives, takes images and computes up to that time. @return  False if the trial is over.
  bool play_until(core::TimeNs time_ns) {
    while (camera_.time_of(next_capture_, episode_.seed) <= time_ns) {
      const core::TimeNs capture_ns = camera_.time_of(next_capture_, episode_.seed);
      // Only what comes before: a server that becomes free at the moment of the exposure
      // chooses among all images, this one too.
      if (!compute_until(capture_ns - 1) || !drive_to(capture_ns)) return false;
      ++next_capture_;
      if (is_dropped(capture_ns)) {
        eye_.skip();
        continue;
      }
      schedule_.capture(
          capture_ns,
          eye_.take(capture_ns, drive_.pose(), drive_.estimate(), drive_.velocity()).index);
    }
    return compute_until(time_ns) && drive_to(time_ns);
  }

  /// Whether a fault takes the image of that time away.
  bool is_dropped(core::TimeNs capture_ns) {
    bool dropped = false;
    for (FrameDropFault& fault : frames_to_drop_) {
      if (capture_ns < fault.from_ns || fault.count == 0) continue;
      --fault.count;
      dropped = true;
    }
    result_.frames_dropped += dropped ? 1 : 0;
    return dropped;
  }

  /// Computes up to that time; drives as far as the last command that came into effect.
  bool compute_until(core::TimeNs time_ns) {
    schedule_.advance_to(time_ns);
    for (const std::uint64_t index : schedule_.take_dropped()) eye_.dropped(index);
    for (const Schedule::Result& done : schedule_.take_results()) eye_.ready(done.index);
    for (const Schedule::Effect& effect : schedule_.take_effects()) {
      if (!drive_to(effect.time_ns) || !apply(effect)) return false;
    }
    return true;
  }

  bool drive_to(core::TimeNs time_ns) {
    if (drive_.drive_to(time_ns)) return true;
    result_.outcome = Outcome::kCollision;
    return false;
  }

  /// A command reaches the wheels. @return  False if the trial is over.
  bool apply(const Schedule::Effect& effect) {
    const Pending pending = pending_.at(effect.tick);
    pending_.erase(effect.tick);
    const bool late = result_.timing.end_to_end.add(effect.time_ns - pending.capture_ns);
    if (pending.stop) {
      drive_.set_command({});
      judge(pending.stop_reason);
      return false;
    }
    // An actuation delay that varies may let a newer command overtake.
    if (effect.tick < newest_effect_) return true;
    newest_effect_ = effect.tick;
    if (pending.too_old) return true;  // The rule on the age has answered in its place.
    return answer(late ? budget_.on_miss : OnMiss::kUseStale, pending.command);
  }

  /// Gives the base the command, or what the rule puts in its place.
  bool answer(OnMiss rule, const core::VelocityCommand& command) {
    switch (rule) {
      case OnMiss::kUseStale:
        drive_.set_command(command);
        return true;
      case OnMiss::kDrop:
        return true;
      case OnMiss::kHold:
        drive_.send_again();
        return true;
      case OnMiss::kZeroCommand:
        drive_.set_command({});
        return true;
      case OnMiss::kAbort:
        drive_.set_command({});
        result_.outcome = Outcome::kAborted;
        return false;
    }
    return true;
  }

  /// What a STOP at this moment is worth.
  void judge(const std::string& reason) {
    const Capture* newest = eye_.newest();
    // The final view is what the camera sees now, also if no image is due.
    const GoalView view = newest != nullptr && newest->time_ns == drive_.time_ns()
                              ? newest->goal
                              : eye_.look(drive_.pose());
    result_.stop_reason = reason;
    result_.final_goal_pixels = view.largest_instance;
    result_.outcome = classify_stop(reason, distance_m(), eye_.goal_visible(view), options_);
  }

  [[nodiscard]] double distance_m() const {
    if (!to_goal_) return std::numeric_limits<double>::infinity();
    return to_goal_->at({drive_.pose().x_m, drive_.pose().y_m}, DistanceField::kBaseSnap_m);
  }

  /// Decides, if there is something new; records. @return  False if the trial is over.
  bool one_tick(int tick, core::TimeNs now_ns) {
    TickRecord record;
    record.time_ns = now_ns;
    record.pose = drive_.pose();
    record.estimate = drive_.estimate();
    record.in_contact = drive_.in_contact();
    bool goes_on = true;
    if (take_news(now_ns)) {
      record.fresh = true;
      decide(tick, now_ns);
      // What takes no time happens within the tick.
      goes_on = compute_until(now_ns);
    } else {
      ++result_.timing.ticks_without_news;
      if (sends_again_) drive_.send_again();
    }
    if (eye_.in_use() != nullptr) {
      record.capture_index = static_cast<std::int64_t>(eye_.in_use()->index);
      record.age_ns = now_ns - eye_.in_use()->time_ns;
      record.detections_hash = eye_.in_use()->detections_hash;
      result_.timing.age.add(record.age_ns);
      if (goes_on) goes_on = check_age(record.age_ns);
    } else {
      ++result_.timing.ticks_without_image;
    }
    note(tick, record);
    return goes_on && !stop_decided_without_effect(tick, now_ns);
  }

  /// Whether a new image is there and the policy is free for it.
  bool take_news(core::TimeNs now_ns) {
    if (eye_.ready() == nullptr || schedule_.deciding()) return false;
    const core::TimeNs age_ns = now_ns - eye_.ready()->time_ns;
    if (budget_.on_miss == OnMiss::kDrop && budget_.end_to_end_deadline_ns > 0 &&
        age_ns > budget_.end_to_end_deadline_ns) {
      result_.timing.end_to_end.add(age_ns);  // At least that late.
      eye_.discard_ready();
      sends_again_ = false;
      return false;
    }
    eye_.detect(*eye_.ready());  // If no stage has.
    eye_.use_ready();
    sends_again_ = true;
    return true;
  }

  void decide(int tick, core::TimeNs now_ns) {
    const Capture& capture = *eye_.in_use();
    const core::Pose2 pose = drive_.estimate();
    const bool at_use = options_.clock.registration == Registration::kUse;
    const core::TimeNs start_ns = wall_ns();
    decision_ = policy_.decide(eye_.observation(capture, at_use ? &pose : nullptr),
                               capture.detections);
    policy_ns_ = wall_ns() - start_ns;
    policy_sum_ns_ += policy_ns_;
    ++decisions_;
    if (decision_.stop) decision_.command = {};
    const auto index = static_cast<std::uint64_t>(tick);
    // Told here: a command that takes no time is applied before check_age() looks at it.
    const bool too_old =
        budget_.on_max_age != OnMiss::kUseStale && exceeds_max_age(now_ns - capture.time_ns);
    pending_[index] = {decision_.command, capture.time_ns, decision_.stop,
                       decision_.stop_reason, too_old};
    schedule_.decide(now_ns, index);
  }

  [[nodiscard]] bool exceeds_max_age(core::TimeNs age_ns) const {
    return budget_.max_age_ns > 0 && age_ns > budget_.max_age_ns;
  }

  bool check_age(core::TimeNs age_ns) {
    // A rule that lets the command pass has nothing to do.
    if (!exceeds_max_age(age_ns) || budget_.on_max_age == OnMiss::kUseStale) return true;
    sends_again_ = budget_.on_max_age == OnMiss::kHold;
    for (auto& [tick, pending] : pending_) pending.too_old = true;
    return answer(budget_.on_max_age, {});
  }

  /// The robot goes on until its STOP reaches the wheels: tick for tick as before, but nothing
  /// is decided any more.
  bool stop_decided_without_effect(int tick, core::TimeNs now_ns) {
    if (!decision_.stop) return false;
    for (core::TimeNs t = now_ns; pending_.contains(static_cast<std::uint64_t>(tick));) {
      t += period_ns_;
      if (!play_until(t)) break;
      if (sends_again_) drive_.send_again();
      if (!check_age(t - eye_.in_use()->time_ns)) break;
    }
    return true;
  }

  /// The tick's truth and statistics.
  void note(int tick, TickRecord& record) {
    record.command = decision_.command;
    record.mode = decision_.mode;
    if (eye_.newest() != nullptr) {
      record.goal_pixels = eye_.newest()->goal.pixels;
      if (result_.first_visible_tick < 0 && eye_.goal_visible(eye_.newest()->goal)) {
        result_.first_visible_tick = tick;
      }
    }
    if (const Capture* used = eye_.in_use(); used != nullptr) {
      const int goal = eye_.goal().class_index;
      record.detections_of_goal = static_cast<int>(std::count_if(
          used->detections.begin(), used->detections.end(),
          [goal](const core::Detection& d) { return goal >= 0 && d.class_index == goal; }));
      if (result_.first_detected_tick < 0 && record.detections_of_goal > 0) {
        result_.first_detected_tick = tick;
      }
    }
    result_.state_hash = record.state_hash = chain_hash(result_.state_hash, record);
    result_.track.push_back(record);
    if (observer_ && eye_.newest() != nullptr) {
      static const std::vector<core::Detection> kNone;
      observer_(record, eye_.newest()->frame,
                eye_.in_use() != nullptr ? eye_.in_use()->detections : kNone, policy_);
    }
  }

  void finish() {
    result_.ticks = static_cast<int>(result_.track.size());
    eye_.report(result_);
    result_.policy_ms = decisions_ == 0 ? 0.0 : ms_from_ns(policy_sum_ns_) / decisions_;
    result_.final_view = policy_.view();
    result_.final_estimate = drive_.estimate();
    result_.final_pose = drive_.pose();
    if (result_.stop_reason.empty() && eye_.newest() != nullptr) {
      result_.final_goal_pixels = eye_.newest()->goal.largest_instance;
    }
    schedule_.report(result_.timing);
    result_.timing.span_ns = drive_.time_ns();
    result_.path_m = drive_.path_m();
    result_.contact_log = drive_.contacts();
    result_.contacts = static_cast<int>(result_.contact_log.size());
    result_.contact_s = drive_.contact_s();
    result_.sensors = drive_.take_sensor_log();
    result_.sensors.camera = eye_.take_validity();
    result_.sim_s = core::seconds(drive_.time_ns());
    result_.distance_to_goal_m = distance_m();
  }

  /// A command on its way to the wheels.
  struct Pending {
    core::VelocityCommand command;
    core::TimeNs capture_ns = 0;
    bool stop = false;
    std::string stop_reason;
    bool too_old = false;  ///< Its image exceeded the largest age.
  };

  const Episode& episode_;
  const TrialOptions& options_;
  core::Policy& policy_;
  const TickObserver& observer_;
  TrialResult result_;
  std::optional<DistanceField> to_goal_;
  TrialDrive drive_;
  TrialEye eye_;
  const LatencyBudget budget_;
  Schedule schedule_;
  core::TimeNs period_ns_;
  SensorRate camera_;
  Pacer pacer_;
  std::vector<FrameDropFault> frames_to_drop_;  ///< Counts are what is left.
  std::uint64_t next_capture_ = 0;
  core::Decision decision_{{}, core::PolicyMode::kInitialize, false, {}};
  core::TimeNs policy_ns_ = 0, policy_sum_ns_ = 0;
  int decisions_ = 0;
  std::map<std::uint64_t, Pending> pending_;  ///< By tick.
  std::uint64_t newest_effect_ = 0;
  bool sends_again_ = true;
};

}  // namespace

const char* to_string(Outcome outcome) {
  switch (outcome) {
    case Outcome::kSuccess:
      return "success";
    case Outcome::kStoppedFar:
      return "stopped_far";
    case Outcome::kNotVisible:
      return "not_visible";
    case Outcome::kTimeout:
      return "timeout";
    case Outcome::kGaveUp:
      return "gave_up";
    case Outcome::kCollision:
      return "collision";
    case Outcome::kAborted:
      return "aborted";
  }
  return "unknown";
}

TrialResult run_trial(const Episode& episode, const TrialOptions& options, const World& world,
                      const RobotModel& robot, core::Renderer& renderer,
                      core::Detector& detector, core::Policy& policy, GroundTruthSink* truth,
                      const TickObserver& observer) {
  const core::TimeNs start_ns = wall_ns();
  Loop loop(episode, options, world, robot, renderer, detector, policy, truth, observer);
  TrialResult result = loop.run();
  result.success = result.outcome == Outcome::kSuccess;
  result.shortest_path_m = episode.shortest_path_m;
  result.spl = spl(result.success, episode.shortest_path_m, result.path_m);
  result.soft_spl =
      soft_spl(result.distance_to_goal_m, episode.shortest_path_m, result.path_m);
  result.wall_s = core::seconds(wall_ns() - start_ns);
  return result;
}

}  // namespace segsim::sim
