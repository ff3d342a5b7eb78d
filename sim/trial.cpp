#include "sim/trial.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <string_view>

#include "core/check.h"
#include "core/error.h"
#include "core/random.h"
#include "sim/metrics.h"

namespace segsim::sim {
namespace {

using Clock = std::chrono::steady_clock;

/// What a tick needs: images for the detector and the map, labels for the judge.
constexpr core::Channels kTickChannels = core::Channels::kRgbd | core::Channels::kLabels;

double ms_since(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

/// A base that is free may stand up to (circumscribed - inscribed radius) outside the free
/// space of a disc; plus a cell. Far less than the thickness of two radii that separates
/// rooms.
constexpr double kGoalSnap_m = 0.30;
constexpr double kContactDebounce_s = 0.5;

/// What the true frame says about the goal.
struct GoalView {
  int pixels = 0;            ///< Of all goal instances.
  int largest_instance = 0;  ///< Pixels of the one seen best.
};

GoalView look_for_goal(const core::Frame& frame, std::uint16_t class_id) {
  GoalView view;
  if (class_id == 0) return view;
  std::vector<std::pair<std::uint16_t, int>>
      counts;  // Few instances of one class are in view.
  for (std::size_t k = 0; k < frame.semantic.size(); ++k) {
    if (frame.semantic.pixels()[k] != class_id) continue;
    ++view.pixels;
    const std::uint16_t id = frame.instance.pixels()[k];
    auto found = std::find_if(counts.begin(), counts.end(),
                              [id](const auto& entry) { return entry.first == id; });
    if (found == counts.end()) found = counts.insert(counts.end(), {id, 0});
    view.largest_instance = std::max(view.largest_instance, ++found->second);
  }
  return view;
}

double invalid_share(const core::Image<float>& alpha) {
  if (alpha.empty()) return 0.0;
  const auto invalid = std::count_if(alpha.pixels().begin(), alpha.pixels().end(),
                                     [](float a) { return !(a >= 0.5F); });
  return static_cast<double>(invalid) / static_cast<double>(alpha.size());
}

/// What a depth camera of limited range would deliver.
void measure_depth(const core::Image<float>& true_depth_m, double range_m,
                   core::Image<float>& measured_m) {
  measured_m.resize(true_depth_m.width_px(), true_depth_m.height_px());
  const auto limit_m = static_cast<float>(range_m);
  std::transform(true_depth_m.pixels().begin(), true_depth_m.pixels().end(),
                 measured_m.pixels().begin(), [limit_m](float d) {
                   return d > 0.0F && d <= limit_m ? d
                                                   : std::numeric_limits<float>::quiet_NaN();
                 });
}

std::uint64_t chain_hash(std::uint64_t previous, const TickRecord& record) {
  const auto quantised = [](double value) { return std::llround(value * 1e6); };
  const std::array<std::int64_t, 7> state = {record.time_ns,
                                             quantised(record.pose.x_m),
                                             quantised(record.pose.y_m),
                                             quantised(record.pose.yaw_rad),
                                             quantised(record.command.forward_mps),
                                             quantised(record.command.turn_radps),
                                             static_cast<std::int64_t>(record.mode)};
  // Bytes in a fixed order, so that the hash is the same on every machine.
  std::array<char, 8 * state.size()> bytes{};
  for (std::size_t k = 0; k < bytes.size(); ++k) {
    const auto word = static_cast<std::uint64_t>(state[k / 8]);
    bytes[k] = static_cast<char>((word >> (8 * (k % 8))) & 0xffU);
  }
  return core::hash64(std::string_view(bytes.data(), bytes.size()), previous);
}

int index_of_class(const core::Detector& detector, const std::string& name) {
  const std::vector<std::string>& names = detector.class_names();
  const auto found = std::find(names.begin(), names.end(), name);
  return found == names.end() ? -1 : static_cast<int>(found - names.begin());
}

/// The robot in the world, with its odometer and its bumper.
class Drive {
 public:
  Drive(const Episode& episode, const TrialOptions& options, const World& world,
        const RobotModel& model)
      : options_(options), collision_(world.collision()), robot_(model, episode.start) {
    substeps_ = static_cast<int>(std::lround(options.control_period_s / options.substep_s));
    SEGSIM_CHECK(substeps_ >= 1 &&
                     std::abs(substeps_ * options.substep_s - options.control_period_s) < 1e-9,
                 "the control period is a whole number of substeps");
    if (collision_.collides(episode.start)) {
      throw core::InputError::expected("episode " + episode.id, "a free start", "a collision");
    }
  }

  /// One control period. @return false if it was cut short by a contact that ends the trial.
  bool run(const core::VelocityCommand& command) {
    in_contact_ = false;
    robot_.set_command(command);
    for (int k = 0; k < substeps_; ++k) {
      const core::Pose2 before = robot_.state().pose;
      const core::VelocityCommand velocity = robot_.update_velocity(options_.substep_s);
      const MoveResult moved = collision_.move(before, velocity, options_.substep_s);
      path_m_ += std::hypot(moved.pose.x_m - before.x_m, moved.pose.y_m - before.y_m);
      robot_.set_pose(moved.pose);
      ++step_;
      if (moved.contact) {
        note_contact();
        if (options_.stop_on_contact) return false;
      }
    }
    return true;
  }

  [[nodiscard]] const core::Pose2& pose() const { return robot_.state().pose; }
  [[nodiscard]] bool in_contact() const { return in_contact_; }
  [[nodiscard]] double path_m() const { return path_m_; }
  [[nodiscard]] int contacts() const { return contacts_; }
  [[nodiscard]] double contact_s() const { return contact_steps_ * options_.substep_s; }
  [[nodiscard]] double time_s() const {
    return static_cast<double>(step_) * options_.substep_s;
  }

 private:
  void note_contact() {
    robot_.set_velocity({});
    in_contact_ = true;
    ++contact_steps_;
    const double pause_s =
        static_cast<double>(step_ - last_contact_step_) * options_.substep_s;
    if (last_contact_step_ < 0 || pause_s > kContactDebounce_s) ++contacts_;
    last_contact_step_ = step_;
  }

  const TrialOptions& options_;
  const CollisionWorld& collision_;
  Robot robot_;
  int substeps_ = 0;
  std::int64_t step_ = 0, last_contact_step_ = -1;
  bool in_contact_ = false;
  double path_m_ = 0.0;
  int contacts_ = 0, contact_steps_ = 0;
};

/// Sense, detect, decide: one tick without the motion, and its share of the statistics.
class Mind {
 public:
  Mind(const Episode& episode, const TrialOptions& options, const World& world,
       core::Renderer& renderer, core::Detector& detector, core::Policy& policy,
       GroundTruthSink* truth)
      : options_(options),
        renderer_(renderer),
        detector_(detector),
        policy_(policy),
        truth_(truth),
        goal_{episode.class_name, index_of_class(detector, episode.class_name)},
        T_robot_camera_(
            core::mast_camera(options.camera_height_m, options.camera_pitch_down_rad)) {
    const core::SceneClass* scene_class = world.manifest().find_class(episode.class_name);
    goal_class_id_ = scene_class != nullptr ? scene_class->id : std::uint16_t{0};
    policy_.reset(goal_, episode.seed);
  }

  core::Decision decide(TickRecord& record, int tick, TrialResult& result) {
    const auto T_world_robot = core::transform_from_pose2<core::frame::World>(record.pose);
    auto start = Clock::now();
    renderer_.render(T_world_robot * T_robot_camera_, options_.camera, kTickChannels, frame_);
    render_ms_ += ms_since(start);

    measure_depth(frame_.depth_m, options_.depth_range_m, depth_m_);
    core::Observation observation;
    observation.capture_time_ns = record.time_ns;
    observation.capture_index = static_cast<std::uint64_t>(tick);
    observation.intrinsics = options_.camera;
    // Localisation is perfect: Odom is World.
    observation.T_odom_robot = core::transform_from_pose2<core::frame::Odom>(record.pose);
    observation.T_robot_camera = T_robot_camera_;
    observation.rgb = &frame_.rgb;
    observation.depth_m = &depth_m_;

    if (truth_ != nullptr) truth_->set_truth(frame_);
    start = Clock::now();
    detections_ = detector_.detect(observation);
    detect_ms_ += ms_since(start);
    start = Clock::now();
    core::Decision decision = policy_.decide(observation, detections_);
    policy_ms_ += ms_since(start);

    view_ = look_for_goal(frame_, goal_class_id_);
    record.goal_pixels = view_.pixels;
    record.detections_of_goal = static_cast<int>(std::count_if(
        detections_.begin(), detections_.end(), [this](const core::Detection& d) {
          return goal_.class_index >= 0 && d.class_index == goal_.class_index;
        }));
    record.command = decision.stop ? core::VelocityCommand{} : decision.command;
    record.mode = decision.mode;
    invalid_share_ += invalid_share(frame_.alpha);
    if (result.first_visible_tick < 0 && goal_visible()) result.first_visible_tick = tick;
    if (result.first_detected_tick < 0 && record.detections_of_goal > 0) {
      result.first_detected_tick = tick;
    }
    ++ticks_;
    return decision;
  }

  void observe(const TickObserver& observer, const TickRecord& record) const {
    if (observer) observer(record, frame_, detections_, policy_);
  }
  [[nodiscard]] bool goal_visible() const {
    return view_.largest_instance >= options_.visible_pixels;
  }
  void finish(TrialResult& result) const {
    result.ticks = ticks_;
    const double share = 1.0 / std::max(1, ticks_);
    result.render_ms = render_ms_ * share;
    result.detect_ms = detect_ms_ * share;
    result.policy_ms = policy_ms_ * share;
    result.invalid_pixel_fraction = invalid_share_ * share;
    result.final_view = policy_.view();
  }

 private:
  const TrialOptions& options_;
  core::Renderer& renderer_;
  core::Detector& detector_;
  core::Policy& policy_;
  GroundTruthSink* truth_;
  core::ObjectGoal goal_;
  std::uint16_t goal_class_id_ = 0;
  core::Transform<core::frame::Robot, core::frame::Camera> T_robot_camera_;
  core::Frame frame_;
  core::Image<float> depth_m_;
  std::vector<core::Detection> detections_;
  GoalView view_;
  int ticks_ = 0;
  double render_ms_ = 0.0, detect_ms_ = 0.0, policy_ms_ = 0.0, invalid_share_ = 0.0;
};

/// What a STOP amounts to. Near is strict: at exactly the success distance it fails.
Outcome classify_stop(const std::string& reason, double distance_m, bool visible,
                      const TrialOptions& options) {
  if (reason != "goal_reached") return Outcome::kGaveUp;
  if (!(distance_m < options.success_distance_m)) return Outcome::kStoppedFar;
  return visible || !options.require_visible ? Outcome::kSuccess : Outcome::kNotVisible;
}

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
  }
  return "unknown";
}

TrialResult run_trial(const Episode& episode, const TrialOptions& options, const World& world,
                      const RobotModel& robot, core::Renderer& renderer,
                      core::Detector& detector, core::Policy& policy, GroundTruthSink* truth,
                      const TickObserver& observer) {
  const auto wall_start = Clock::now();
  TrialResult result;
  result.shortest_path_m = episode.shortest_path_m;
  const DistanceField to_goal = world.distance_to(episode.view_points_m);
  Drive drive(episode, options, world, robot);
  Mind mind(episode, options, world, renderer, detector, policy, truth);
  const core::TimeNs period_ns = std::llround(options.control_period_s * 1e9);
  const core::TimeNs limit_ns = std::llround(options.time_limit_s * 1e9);
  const auto distance_now = [&] {
    return to_goal.at({drive.pose().x_m, drive.pose().y_m}, kGoalSnap_m);
  };

  // A STOP at exactly the time limit still counts.
  for (int tick = 0; tick * period_ns <= limit_ns; ++tick) {
    TickRecord record;
    record.time_ns = tick * period_ns;
    record.pose = drive.pose();
    record.in_contact = drive.in_contact();
    const core::Decision decision = mind.decide(record, tick, result);
    result.track.push_back(record);
    result.state_hash = chain_hash(result.state_hash, record);
    mind.observe(observer, record);

    if (decision.stop) {
      result.stop_reason = decision.stop_reason;
      result.outcome =
          classify_stop(decision.stop_reason, distance_now(), mind.goal_visible(), options);
      break;
    }
    if ((tick + 1) * period_ns <= limit_ns && !drive.run(decision.command)) {
      result.outcome = Outcome::kCollision;
      break;
    }
  }

  mind.finish(result);
  result.success = result.outcome == Outcome::kSuccess;
  result.path_m = drive.path_m();
  result.contacts = drive.contacts();
  result.contact_s = drive.contact_s();
  result.sim_s = drive.time_s();
  result.distance_to_goal_m = distance_now();
  result.spl = spl(result.success, episode.shortest_path_m, result.path_m);
  result.soft_spl =
      soft_spl(result.distance_to_goal_m, episode.shortest_path_m, result.path_m);
  result.wall_s = 1e-3 * ms_since(wall_start);
  return result;
}

}  // namespace segsim::sim
