#include "experiments/trials/trial_runner.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/error.h"
#include "core/random.h"
#include "core/version.h"
#include "experiments/drawing/trial_picture.h"
#include "experiments/reproducibility/backend_warning.h"
#include "experiments/ros2/ros2_policy.h"
#include "experiments/ros2/truth_tap.h"
#include "experiments/support/stop_signal.h"
#include "experiments/trials/arm_detector.h"
#include "experiments/trials/internal/trial_outputs.h"
#include "experiments/trials/trial_options.h"
#include "nav/policies/built_in_policies.h"
#include "renderer/renderer_backend.h"
#include "sim/trial/oracle_way.h"
#include "sim/trial/thing_names.h"

namespace segsim::experiments::trials {
namespace {

namespace fs = std::filesystem;

sim::TrialOptions trial_options(const specs::ExperimentSpec& spec, const LoadedScene& loaded) {
  const sim::SuccessProfile rule = spec.success.rule();
  sim::TrialOptions options =
      base_trial_options(spec, loaded.spec->camera_height_m, loaded.sensors);
  // Rules of another kind are applied to the end of the trial, in judge_trial().
  const bool by_view_point = rule.rule == sim::SuccessRule::kViewPoint;
  options.success_distance_m =
      by_view_point ? rule.distance_m : sim::SuccessProfile{}.distance_m;
  options.require_visible = by_view_point && rule.require_visible;
  options.visible_pixels = spec.success.visible_pixels;
  return options;
}

/// A repetition differs from the first trial in its random numbers.
sim::Episode episode_of(const TrialTask& task) {
  sim::Episode episode = *task.episode;
  if (task.repetition > 0) {
    episode.seed = core::hash64("repetition " + std::to_string(task.repetition), episode.seed);
  }
  return episode;
}

/// @param episode  Outlives what is returned.
drawing::TrialScene scene_of(const TrialTask& task, const sim::Episode& episode,
                             int goal_index) {
  drawing::TrialScene scene;
  scene.plan = &task.scene->plan;
  scene.manifest = &task.scene->bundle.manifest;
  scene.episode = &episode;
  scene.scene_title = task.scene->spec->title;
  scene.arm = task.arm->name;
  scene.goal_index = goal_index;
  const auto to_goal = std::make_shared<sim::DistanceField>(
      task.scene->world.distance_to(episode.view_points_m));
  scene.shortest_path_m = to_goal->path_from({episode.start.x_m, episode.start.y_m});
  scene.distance_m = [to_goal](const glm::dvec2& p_m) {
    return to_goal->at(p_m, sim::DistanceField::kBaseSnap_m);
  };
  return scene;
}

/// How time passes; a trial that measured time is repeated with the times that it recorded.
sim::TrialClock clock_for(const specs::ExperimentSpec& spec, const TrialTask& task) {
  sim::TrialClock clock = specs::trial_clock(spec.clock, task.arm->clock);
  if (task.replay == nullptr || !clock.measures()) return clock;
  clock.budget = sim::with_trace(clock.played_budget(),
                                 std::make_shared<sim::LatencyTrace>(task.replay->trace));
  clock.mode = sim::ClockMode::kVirtual;
  return clock;
}

records::ReplayLog start_log(const specs::ExperimentSpec& spec, const TrialTask& task) {
  records::ReplayLog log;
  log.spec_text = spec.text;
  log.spec_file = spec.file.string();
  log.scene = task.scene->spec->name;
  log.arm = task.arm->name;
  log.episode = task.episode->id;
  log.repetition = task.repetition;
  log.scene_sha256 = task.scene->bundle.scene_sha256;
  log.code_version = core::version();
  log.clock_mode = sim::to_string(spec.clock.mode);
  log.images = task.replay_log && spec.replays.images;
  return log;
}

void copy_result(const sim::TrialResult& result, records::TrialRow& row) {
  row.outcome = records::trial_outcome(result.outcome);
  row.success = result.success;
  row.stop_reason = result.stop_reason;
  row.spl = result.spl;
  row.soft_spl = result.soft_spl;
  row.path_m = result.path_m;
  row.shortest_path_m = result.shortest_path_m;
  if (std::isfinite(result.distance_to_goal_m))
    row.distance_to_goal_m = result.distance_to_goal_m;
  row.sim_s = result.sim_s;
  row.wall_s = result.wall_s;
  row.ticks = result.ticks;
  row.contacts = result.contacts;
  row.contact_s = result.contact_s;
  row.first_visible_tick = result.first_visible_tick;
  row.first_detected_tick = result.first_detected_tick;
  row.invalid_pixel_fraction = result.invalid_pixel_fraction;
  row.state_hash = result.state_hash;
  row.render_ms = result.render_ms;
  row.detect_ms = result.detect_ms;
  row.policy_ms = result.policy_ms;
}

/// What people who watch are told of the trial.
LiveTrial live_trial(const TrialTask& task, const drawing::TrialScene& scene,
                     const std::vector<std::string>& detector_classes, double time_limit_s) {
  return {task.scene->spec->name,
          scene.scene_title,
          scene.arm,
          task.episode->id,
          task.episode->goal_name(),
          task.repetition,
          scene.goal_index,
          detector_classes,
          fs::absolute(task.scene->bundle.folder).lexically_normal(),
          time_limit_s,
          task.episode->start,
          scene.shortest_path_m,
          task.episode->goal_instances};
}

/// By the rules of the policy, if it is one that has them.
nav::DetectorRoute route_of(const nav::PolicyChoice& policy, const specs::ArmSpec& arm,
                            const RoutedDetector& detector, const std::string& target) {
  const auto* vlfm = policy.settings<nav::VlfmSettings>();
  return nav::route_target(target, detector.closed_class_names(), arm.open_targets,
                           vlfm != nullptr ? vlfm->rules : nav::VlfmRules());
}

/// Passes a detector's answers on and shows them to who watches.
class ViewedDetector final : public core::Detector {
 public:
  ViewedDetector(core::Detector& inner, TrialViewer* viewer)
      : inner_(inner), viewer_(viewer) {}
  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return inner_.class_names();
  }
  [[nodiscard]] std::vector<core::Detection> detect(const core::Observation& seen) override {
    std::vector<core::Detection> found = inner_.detect(seen);
    if (viewer_ != nullptr) viewer_->observe(seen, found);
    return found;
  }

 private:
  core::Detector& inner_;
  TrialViewer* viewer_;  // May be null.
};

int index_of(const std::vector<std::string>& names, const std::string& name) {
  const auto found = std::find(names.begin(), names.end(), name);
  return found == names.end() ? -1 : static_cast<int>(found - names.begin());
}

}  // namespace

const nav::PolicyChoice& policy_of(const specs::ExperimentSpec& spec,
                                   const specs::ArmSpec& arm) {
  return arm.policy ? *arm.policy : spec.policy;
}

Starts starts_of(const LoadedScene& scene) {
  Starts starts_m;
  for (const sim::Episode& episode : scene.episodes.episodes) {
    starts_m.emplace_back(episode.start.x_m, episode.start.y_m);
  }
  return starts_m;
}

PreparedWeights weights_of(const specs::ArmSpec& arm, const std::string& scene,
                           const PreparedDetectors& detectors) {
  if (arm.detector == specs::ArmDetector::kFile)
    return {arm.weights, std::nullopt, std::nullopt, nullptr};
  const auto found = detectors.find(prepared_key(arm, scene));
  return found == detectors.end() ? PreparedWeights{} : found->second;
}

TrialRunner::TrialRunner(const specs::ExperimentSpec& spec, PreparedDetectors detectors,
                         fs::path work, std::size_t views_bytes)
    : spec_(spec),
      detectors_(std::move(detectors)),
      work_(std::move(work)),
      views_bytes_(views_bytes),
      live_(work_) {}

void TrialRunner::set_renderer(const std::string& scene,
                               std::unique_ptr<core::Renderer> renderer) {
  views_.reset();
  renderers_[scene] = std::move(renderer);
}

core::Renderer& TrialRunner::renderer_for(const LoadedScene& scene) {
  std::unique_ptr<core::Renderer>& renderer = renderers_[scene.spec->name];
  if (renderer == nullptr) {
    // Trials run side by side, so each of them renders on its own thread only.
    renderer::RenderOptions options;
    options.threads = 1;
    renderer = renderer::make_renderer(spec_.camera.backend, scene.surfels, options,
                                       scene.labels, reproducibility::warn_about_backend);
  }
  return *renderer;
}

core::Renderer& TrialRunner::eye_for(const TrialTask& task) {
  core::Renderer& renderer = renderer_for(*task.scene);
  // Measured time is to be that of drawing.
  if (spec_.arms.size() < 2 || spec_.clock.mode == sim::ClockMode::kMeasured ||
      spec_.clock.mode == sim::ClockMode::kRealtime) {
    return renderer;
  }
  const std::string episode = task.scene->spec->name + "\n" + task.episode->id;
  if (!views_ || views_of_ != episode) {
    views_.emplace(renderer, views_bytes_);
    views_of_ = episode;
  }
  return *views_;
}

TrialRunner::ArmDetectorSlot& TrialRunner::detector_for(const LoadedScene& scene,
                                                        const specs::ArmSpec& arm) {
  const bool oracle = arm.detector == specs::ArmDetector::kOracle;
  // A prompted detector, or another program, looks for the goals of its scene.
  const bool per_scene = oracle || is_prompted(arm) ||
                         arm.detector == specs::ArmDetector::kProcess ||
                         !arm.open_detector.empty() || specs::is_tuned_by_scene(arm.detector);
  if (arm.detector == specs::ArmDetector::kProcess) {
    // Programs of other scenes need not wait with their networks in memory.
    std::erase_if(slots_, [&](const auto& named) {
      return named.second.process != nullptr &&
             !named.first.starts_with(scene.spec->name + "/");
    });
  }
  ArmDetectorSlot& slot = slots_[per_scene ? scene.spec->name + "/" + arm.name : arm.name];
  if (slot.process != nullptr) slot.process->start();  // Not within a time that is measured.
  if (slot.detector != nullptr) return slot;
  if (oracle) {
    const std::vector<core::SceneClass>& classes = scene.bundle.manifest.classes;
    sim::OracleDetectorOptions options;
    options.min_pixels = spec_.success.visible_pixels;
    options.seed = spec_.seed;
    auto detector =
        std::make_unique<sim::OracleDetector>(classes, sim::thing_names(classes), options);
    slot.truth = detector.get();
    slot.detector = std::move(detector);
  } else {
    slot.process = detector_process(arm, scene);
    slot.detector = slot.process != nullptr
                        ? peers::make_peer_detector(slot.process)
                        : load_arm_detector(arm, detectors_, scene, compute_device(spec_));
    if (!arm.open_detector.empty()) {
      auto routed = std::make_unique<RoutedDetector>(std::move(slot.detector),
                                                     load_open_detector(arm, scene));
      slot.routed = routed.get();
      slot.detector = std::move(routed);
    }
  }
  return slot;
}

sim::ExternalDrive* TrialRunner::drive() {
  if (!spec_.motion) return nullptr;
  if (drive_ == nullptr) {
    sim::GazeboDriveOptions options = *spec_.motion;
    options.interrupted = support::StopOnSignal::requested;
    drive_ = std::make_unique<sim::GazeboDrive>(std::move(options));
  }
  return drive_.get();
}

/// The arm's policy; only "oracle-path" is handed the way to the goal.
std::unique_ptr<core::Policy> TrialRunner::policy_for(const TrialTask& task,
                                                      const ArmDetectorSlot& slot) {
  const nav::PolicyChoice& policy = policy_of(spec_, *task.arm);
  nav::PolicyContext context;
  context.class_names = slot.detector->class_names();
  context.robot = static_cast<const core::RobotBase&>(task.scene->world.robot());
  context.camera_height_m = task.scene->spec->camera_height_m;
  context.models = models_.loaders();
  if (policy.name() == "oracle-path") {
    // Odom equals World with perfect localisation.
    context.oracle = [way = std::make_shared<sim::OracleWay>(task.scene->world,
                                                             task.episode->view_points_m)](
                         const glm::dvec2& from_m) { return way->from(from_m); };
  }
  return policy.make(context);
}

records::TrialRow TrialRunner::run(const TrialTask& task) {
  records::TrialRow row;
  row.arm = task.arm->name;
  row.scene = task.scene->spec->name;
  row.episode = task.episode->id;
  row.goal_class = task.episode->goal_name();
  row.repetition = task.repetition;
  row.shortest_path_m = task.episode->shortest_path_m;
  if (!std::isfinite(row.shortest_path_m)) {
    row.shortest_path_m = 0.0;
    row.outcome = records::TrialOutcome::kInfeasible;
    row.why.cause = records::Cause::kInfeasible;
    return row;
  }
  if (row.shortest_path_m <= 0.0 && !task.scene->spec->allow_trivial) {
    row.outcome = records::TrialOutcome::kTrivial;
    row.why.cause = records::Cause::kTrivial;
    return row;
  }
  try {
    run_checked(task, row);
  } catch (const std::exception& error) {
    row.outcome = records::TrialOutcome::kError;
    row.success = false;
    row.why = {};
    row.why.cause = records::Cause::kHarnessError;
    row.error = error.what();
  }
  return row;
}

void TrialRunner::run_checked(const TrialTask& task, records::TrialRow& row) {
  const sim::Episode episode = episode_of(task);
  // Of a trial that is played again, perception may come from its log.
  records::ReplayRenderer replayed_images(task.replay_images);
  ArmDetectorSlot replayed;
  if (task.replay_perception) {
    replayed.detector = std::make_unique<records::ReplayDetector>(*task.replay);
  }
  const bool draws = task.replay_images.empty();
  core::Renderer& renderer = draws ? renderer_for(*task.scene) : replayed_images;
  core::Renderer& eye = draws ? eye_for(task) : replayed_images;
  ArmDetectorSlot& slot =
      task.replay_perception ? replayed : detector_for(*task.scene, *task.arm);
  if (slot.routed != nullptr) {
    slot.routed->set_route(
        route_of(policy_of(spec_, *task.arm), *task.arm, *slot.routed, episode.class_name),
        episode.class_name);
  }
  const std::vector<std::string>& classes = slot.detector->class_names();
  const std::unique_ptr<core::Policy> policy = policy_for(task, slot);
  sim::ReadingsObserver readings;
  auto* const robot = dynamic_cast<ros2::Ros2Policy*>(policy.get());
  if (robot != nullptr) {
    robot->mount(task.scene->sensors);
    if (robot->settings().map) robot->show(task.scene->world.collision());
    readings = [robot](const sim::SensorLog& log, core::TimeNs now_ns) {
      robot->hear(log, now_ns);
    };
  }
  sim::TrialOptions options = trial_options(spec_, *task.scene);
  options.clock = clock_for(spec_, task);

  const drawing::TrialScene scene =
      scene_of(task, episode, index_of(classes, episode.class_name));
  records::TrialWitness witness(task.scene->bundle.manifest, episode, scene.goal_index);
  TrialOutputs outputs(spec_, task, scene, classes, work_, renderer);
  const sim::TickObserver observer = [&](const sim::TickRecord& tick, const core::Frame& frame,
                                         const std::vector<core::Detection>& detections,
                                         const core::Policy& of) {
    const double tick_index = core::seconds(tick.time_ns) / spec_.control_period_s;
    const auto image = static_cast<std::uint64_t>(tick.capture_index);
    witness.add(static_cast<int>(std::lround(tick_index)), frame,
                tick.fresh ? std::optional(image) : std::nullopt);
    outputs.add(tick, frame, detections, of);
    live_.add(tick, frame, detections, of);
  };

  records::ReplayLog log = start_log(spec_, task);
  live_.begin(live_trial(task, scene, classes, spec_.time_limit_s));
  TimedDetector timed(*slot.detector, live_);
  TimedPolicy timed_policy(*policy, live_);
  records::RecordingDetector recorded(timed, log);
  records::WitnessedDetector detector(recorded, slot.truth, witness);
  ViewedDetector viewed(detector, task.viewer);
  std::optional<ros2::TruthTap> tap;
  if (robot != nullptr && robot->settings().truth) {
    tap.emplace(viewed, detector, *robot, task.scene->bundle.manifest.classes,
                spec_.success.visible_pixels);
  }
  const fs::path log_file = work_ / "replays" / (file_stem(task) + ".jsonl");
  std::optional<records::RecordingRenderer> kept_images;
  if (log.images) kept_images.emplace(eye, records::replay_images(log_file));
  sim::TrialResult result =
      sim::run_trial({.episode = episode,
                      .options = options,
                      .world = task.scene->world,
                      .robot = task.scene->world.robot(),
                      .renderer = kept_images ? *kept_images : eye,
                      .detector = tap ? static_cast<core::Detector&>(*tap) : viewed,
                      .policy = timed_policy,
                      .truth = tap ? static_cast<sim::GroundTruthSink*>(&*tap) : &detector,
                      .observer = observer,
                      .readings = readings,
                      .drive = drive()});
  if (task.replay_log)
    records::write_replay_log(log_file, records::with_result(std::move(log), result));
  std::vector<double> distance_m;
  row.why = judge_trial(task, episode, scene.goal_index, witness, result, distance_m);
  const PreparedWeights weights = weights_of(*task.arm, task.scene->spec->name, detectors_);
  if (weights.tuned_on != nullptr) {
    row.why.stop_views =
        perception::views_near(*weights.tuned_on, task.scene->bundle.manifest.name,
                               {{result.final_pose.x_m, result.final_pose.y_m}},
                               records::kStopRegion_m, episode.class_name);
  }
  copy_result(result, row);
  outputs.finish(result, options, witness, std::move(distance_m), row);
}

records::Attribution TrialRunner::judge_trial(const TrialTask& task,
                                              const sim::Episode& episode, int goal_index,
                                              const records::TrialWitness& witness,
                                              sim::TrialResult& result,
                                              std::vector<double>& distance_m) const {
  const sim::SuccessProfile rule = spec_.success.rule();
  const records::AttributionContext context{&task.scene->world, &task.scene->bundle.manifest,
                                            &episode,           &rule,
                                            goal_index,         spec_.time_limit_s};
  records::Attribution why = records::attribute(context, result, witness, &distance_m);
  if (rule.rule == sim::SuccessRule::kViewPoint) return why;
  const sim::TrialEnd end = records::trial_end(why, result);
  result.success = sim::succeeded(rule, end);
  result.spl = sim::profile_spl(rule, end);
  if (result.success) {
    result.outcome = sim::Outcome::kSuccess;
  } else if (result.outcome == sim::Outcome::kSuccess) {
    result.outcome = sim::Outcome::kStoppedFar;
  }
  return records::attribute(context, result, witness, &distance_m);
}

}  // namespace segsim::experiments::trials
