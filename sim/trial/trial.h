#pragma once

/// @file
/// The closed loop: one robot, one episode, one tick after another. Start reading here.
///
///     true pose -> Renderer -> Observation -> Detector -> Policy -> command -> Robot
///         ^                                                                  |
///
/// One control tick k at t = k * period is five calls in trial.cpp (docs/simulation.md):
///  drive    The robot drives from the tick before to t. Commands take effect in between, when
///           they are due.
///  sense    Images are taken when they are due, at the true pose of that moment.
///  compute  The robot's computer works on them (sim/time/schedule.h). In lockstep that takes
///           no time.
///  decide   The policy decides on the newest result that is ready at t. Its command is due
///           after the policy's own time and the actuation delay. Without a new result the
///           last command is sent again.
///  record   The tick is written down.
///
/// Perception and policy see Observations only; the true state stays in this module.

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "core/stages.h"
#include "sim/ground/robot.h"
#include "sim/ground/world.h"
#include "sim/sensors/localiser.h"
#include "sim/sensors/odometer.h"
#include "sim/sensors/sensor_suite.h"
#include "sim/time/clock.h"
#include "sim/time/timing.h"
#include "sim/trial/external_drive.h"
#include "sim/trial/outcome.h"
#include "sim/trial/trial_faults.h"

namespace segsim::sim {

/// One task: start here, find one object of this class, or one of those that a phrase means.
struct Episode {
  std::string id;  ///< Unique in its set, for example "flat-3/couch/07".
  std::string class_name;
  std::string phrase;  ///< "a red chair"; empty: any object of the class will do.
  std::vector<std::uint16_t> goal_instances;  ///< That the phrase means; empty without one.
  core::Pose2 start;                          ///< World frame.
  std::vector<glm::dvec2> view_points_m;      ///< Places from which a goal object is visible;
                                              ///< success is measured to the nearest one.
  /// Of each view point, if known: the instance that is seen, and how well (IoU of its pixels
  /// with a centred box of half the image's width and height). Same order, or empty.
  std::vector<std::uint16_t> view_point_instance;
  std::vector<float> view_point_iou;
  double shortest_path_m =
      0;  ///< l of SPL: from start to the nearest view point, for this robot.
  std::uint64_t seed = 0;
  std::string source;  ///< Of an imported episode: data set, scene, index and hash.
  /// What rows, tables and pictures call the goal.
  [[nodiscard]] const std::string& goal_name() const {
    return phrase.empty() ? class_name : phrase;
  }
};

/// What the robot's motion is checked against.
enum class CollisionMode : std::uint8_t {
  kFootprint,  ///< The swept rectangle and the mast (sim/ground/collision.h).
  /// A point on the eroded navigation mesh, as Habitat has it (sim/ground/navmesh_walker.h):
  /// turning never collides. For comparisons with Habitat's figures.
  kNavmesh,
};

struct TrialOptions {
  double control_period_s = 0.1;
  double substep_s = 0.005;
  double time_limit_s = 180.0;
  double success_distance_m = 1.0;  ///< STOP must be this near to a view point (geodesic).
  bool require_visible = true;      ///< ... and a goal instance must be in the final view:
  int visible_pixels = 40;          ///< at least this many pixels of it.
  core::CameraIntrinsics camera;
  double camera_height_m = 1.2;
  double camera_pitch_down_rad = 0.0;
  double depth_range_m = 6.0;  ///< Farther depth is not measured (NaN).
  bool stop_on_contact = false;
  ContactResponse contact_response = ContactResponse::kStop;
  CollisionMode collision = CollisionMode::kFootprint;
  std::optional<OdometryNoise> odometry;    ///< What the robot believes is odometry ...
  std::optional<LocaliserModel> localiser;  ///< ... or this; with neither it knows its pose.
  /// nullptr: exact images, and no sensor but the camera.
  std::shared_ptr<const SensorSettings> sensors;
  TrialClock clock;    ///< Lockstep by default.
  TrialFaults faults;  ///< None by default.
};

/// What happened in one control tick (true values, for the record only).
struct TickRecord {
  core::TimeNs time_ns = 0;
  core::Pose2 pose;
  core::Pose2 estimate;  ///< Where the robot believes to be, in Odom.
  core::VelocityCommand command;
  core::PolicyMode mode = core::PolicyMode::kInitialize;
  bool in_contact = false;
  int detections_of_goal = 0;
  int goal_pixels = 0;  ///< Visible pixels of goal instances (ground truth).
  // What the command rests on.
  std::int64_t capture_index = -1;    ///< Of the image in use; -1: none yet.
  core::TimeNs age_ns = 0;            ///< Of that image.
  bool fresh = false;                 ///< The policy decided at this tick.
  std::uint64_t detections_hash = 0;  ///< Of the detections in use, bit by bit.
  std::uint64_t state_hash = 0;       ///< The chain up to and including this tick.
};

/// One touch, from its beginning to 0.5 s after its last moment (true values).
struct ContactRecord {
  core::TimeNs time_ns = 0;
  glm::dvec2 point_m{0.0}, normal{0.0};  ///< World; the normal points at the robot.
  double approach_mps = 0.0;
  double duration_s = 0.0;
  std::uint16_t instance = 0;  ///< Whose box holds the point; 0: none (walls).
};

struct TrialResult {
  Outcome outcome = Outcome::kTimeout;
  bool success = false;
  std::optional<core::StopReason> stop_reason;  ///< None: the policy did not stop.
  double spl = 0, soft_spl = 0;
  double path_m = 0;
  double shortest_path_m = 0;
  double distance_to_goal_m =
      0;  ///< Geodesic, at the end; infinity if off the navigable area.
  double sim_s = 0, wall_s = 0;
  int ticks = 0;
  int frames_dropped = 0;  ///< By faults.
  int contacts = 0;        ///< Separate contacts (0.5 s debounce).
  double contact_s = 0;
  int first_visible_tick = -1, first_detected_tick = -1;
  double invalid_pixel_fraction = 0;  ///< Mean share of pixels with alpha < 0.5.
  /// Chain over all ticks: pose (quantised), command, mode, image and detections in use.
  std::uint64_t state_hash = 0;
  std::vector<TickRecord> track;
  core::PolicyView final_view;  ///< In Odom, which equals World with perfect localisation.
  core::Pose2 final_estimate;   ///< Of the robot, in Odom.
  /// Where the trial ended: where a STOP took effect, or time was over. The last entry of
  /// `track` is older, by what the last decision took.
  core::Pose2 final_pose;
  int final_goal_pixels = 0;  ///< Of the goal instance seen best from there (or last).
  // Mean wall times per image, detector call and decision [ms].
  double render_ms = 0, detect_ms = 0, policy_ms = 0;
  std::vector<ContactRecord> contact_log;  ///< `contacts` of them.
  TimingReport timing;
  LatencyTrace trace;  ///< All durations that were played: the trial again, in virtual time.
  SensorLog sensors;   ///< Empty without TrialOptions::sensors.
};

/// Called after every tick with the newest image, the detections in use and the policy; for
/// videos and logs. Not before the first image.
using TickObserver =
    std::function<void(const TickRecord&, const core::Frame&,
                       const std::vector<core::Detection>&, const core::Policy&)>;

/// Called before every decision, if the robot has sensors besides the camera, with all that
/// they have taken so far. A robot may know of readings with `available_ns` <= now alone.
using ReadingsObserver = std::function<void(const SensorLog&, core::TimeNs now_ns)>;

/// Ground truth for one detector call. Only oracle arms are handed it.
class GroundTruthSink {
 public:
  virtual ~GroundTruthSink() = default;
  /// All randomness of the detector derives from the seed of the episode.
  virtual void begin_episode(const Episode& /*episode*/) {}
  virtual void set_truth(const core::Frame& frame) = 0;
};

/// What a trial is made of, borrowed for the call.
struct TrialParts {
  const Episode& episode;
  const TrialOptions& options;
  const World& world;
  const RobotModel& robot;
  core::Renderer& renderer;
  core::Detector& detector;
  core::Policy& policy;
  /// If not null, receives each rendered frame before the detector runs.
  GroundTruthSink* truth = nullptr;
  TickObserver observer{};      ///< May be empty.
  ReadingsObserver readings{};  ///< May be empty.
  /// If not null, moves the robot; simulated time is that simulator's then. Contacts are those
  /// of the footprint with the scene's mesh, to within a centimetre, and stop nothing.
  /// ClockMode::kRealtime alone.
  ExternalDrive* drive = nullptr;
};

/// Runs one episode. In lockstep and virtual time deterministic: equal parts give equal
/// results (wall times excepted).
/// @throws core::InputError if the robot does not fit where the episode starts.
[[nodiscard]] TrialResult run_trial(const TrialParts& parts);

}  // namespace segsim::sim
