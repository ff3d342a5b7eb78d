#include "experiments/scripted_trials/scripted_run.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/progress.h"
#include "core/random.h"
#include "experiments/episodes/episodes.h"
#include "experiments/records/trial_witness.h"
#include "experiments/scripted_trials/internal/script_metrics.h"
#include "experiments/trials/frame_recorder.h"
#include "experiments/trials/policy_models.h"
#include "experiments/trials/sensor_files.h"
#include "experiments/trials/trial_options.h"
#include "experiments/video/trial_video.h"
#include "perception/data/image_file.h"
#include "perception/detector/detector.h"
#include "perception/models/object_detector.h"
#include "sim/ground/geodesy.h"
#include "sim/trial/oracle_detector.h"
#include "sim/trial/oracle_way.h"
#include "sim/trial/thing_names.h"

namespace segsim::experiments::scripted_trials {
namespace {

namespace fs = std::filesystem;

constexpr double kVideoSpeed = 2.0;  // As the videos of runs.

sim::TrialOptions trial_options(const BoundScript& bound) {
  const ScriptedTrial& script = *bound.script;
  std::shared_ptr<const sim::SensorSettings> sensors;
  if (script.sensors)
    sensors = specs::bind_sensors(*script.sensors, bound.bundle, bound.world);
  sim::TrialOptions options =
      trials::base_trial_options(script, bound.camera_height_m, std::move(sensors));
  options.clock = specs::trial_clock(script.clock, {});
  options.faults = script.faults;
  return options;
}

/// The script's detector, and its sink of ground truth if it is the oracle.
struct Eyes {
  std::unique_ptr<core::Detector> detector;
  sim::GroundTruthSink* truth = nullptr;
};

Eyes make_eyes(const BoundScript& bound) {
  const ScriptedTrial& script = *bound.script;
  Eyes eyes;
  if (!script.weights.empty()) {
    if (!perception::is_foreign_detector(script.weights)) {
      eyes.detector = perception::load_detector(script.weights);
      return eyes;
    }
    perception::ObjectDetectorOptions options;
    for (const ScriptStep& step : script.steps) {
      const bool wanted = step.kind == StepKind::kFind &&
                          std::find(options.prompts.begin(), options.prompts.end(),
                                    step.category) == options.prompts.end();
      if (wanted) options.prompts.push_back(step.category);
    }
    eyes.detector = perception::load_object_detector(script.weights, options);
    return eyes;
  }
  const std::vector<core::SceneClass>& classes = bound.bundle.manifest.classes;
  sim::OracleDetectorOptions options;
  options.seed = script.seed;
  auto oracle =
      std::make_unique<sim::OracleDetector>(classes, sim::thing_names(classes), options);
  eyes.truth = oracle.get();
  eyes.detector = std::move(oracle);
  return eyes;
}

/// Places from which objects of a category are seen, as generated episodes have them.
sim::Episode places_of(const BoundScript& bound, const std::string& category) {
  const ScriptedTrial& script = *bound.script;
  episodes::EpisodeRules rules;
  rules.goals = {category};
  rules.count = 1;
  rules.seed = script.seed;
  rules.camera = script.camera.intrinsics();
  rules.camera_height_m = bound.camera_height_m;
  rules.camera_pitch_down_rad = script.camera.pitch_down_rad();
  rules.min_start_m = 0.0;
  rules.max_start_m = 1e6;
  rules.allow_visible_start = true;
  episodes::EpisodeSet set = episodes::generate_episodes(script.name, bound.bundle,
                                                         bound.world, *bound.renderer, rules);
  if (set.episodes.empty()) {
    throw core::InputError::expected(script.file.string(),
                                     "a place from which a " + category + " is seen", "none");
  }
  return std::move(set.episodes.front());
}

/// Watches the drive with the truth in hand, and writes down what the script wants recorded.
class Watcher {
 public:
  Watcher(BoundScript& bound, const ScriptDriver& driver,
          const std::map<std::string, sim::Episode>& goals, const sim::Episode& episode,
          const std::vector<std::string>& classes, const fs::path& folder)
      : bound_(bound),
        driver_(driver),
        goals_(goals),
        progress_("trial", std::ssize(bound.script->steps)) {
    const ScriptedTrial& script = *bound.script;
    scene_.plan = &bound.plan;
    scene_.manifest = &bound.bundle.manifest;
    scene_.episode = &episode;
    scene_.scene_title = script.title;
    scene_.arm = script.weights.empty() ? "oracle" : script.weights.stem().string();
    if (script.record.video) {
      video_.emplace(folder / "trial.mp4", scene_, classes,
                     kVideoSpeed / script.control_period_s);
    }
    if (script.record.exr_every > 0) {
      frames_.emplace(folder / "frames", bound.bundle, script.record.exr_every,
                      *bound.renderer);
    }
  }

  void see(const sim::TickRecord& tick, const core::Frame& frame,
           const std::vector<core::Detection>& detections, const core::Policy& policy) {
    const glm::dvec2 p_m(tick.pose.x_m, tick.pose.y_m);
    if (last_m_) path_m_ += glm::distance(*last_m_, p_m);
    last_m_ = p_m;
    const auto& steps = driver_.records();
    for (; begun_ < steps.size(); ++begun_) begins_.push_back({p_m, path_m_});
    for (; ended_ < steps.size() && steps[ended_].end; ++ended_) {
      const bool is_find = script_step(ended_).kind == StepKind::kFind;
      if (is_find) finds_.push_back(judge(steps[ended_], begins_[ended_], p_m, frame));
    }
    progress_.update(
        static_cast<std::int64_t>(ended_),
        core::print("%.0f s", core::seconds(tick.time_ns)) +
            (steps.empty() ? std::string()
                           : core::print(", step %zu, %s", steps.size(),
                                         to_string(script_step(steps.size() - 1).kind))));
    if (video_) video_->add(tick, frame, detections, policy.view());
    if (frames_) frames_->add(tick, frame);
  }

  [[nodiscard]] std::vector<FindResult> finish(const sim::TrialResult& result) {
    progress_.finish();
    if (video_) video_->finish(result);
    if (frames_) frames_->finish();
    return std::move(finds_);
  }

 private:
  struct Begin {
    glm::dvec2 p_m;
    double path_m = 0.0;
  };
  [[nodiscard]] const ScriptStep& script_step(std::size_t k) const {
    return bound_.script->steps[k];
  }

  FindResult judge(const StepOutcome& step, const Begin& begin, const glm::dvec2& end_m,
                   const core::Frame& frame) {
    const ScriptStep& wanted = script_step(static_cast<std::size_t>(step.step));
    const sim::Episode& goal = goals_.at(wanted.category);
    records::TrialWitness witness(bound_.bundle.manifest, goal, -1);
    witness.add(0, frame, std::nullopt);
    const sim::DistanceField to_goal = bound_.world.distance_to(goal.view_points_m);
    FindResult result;
    result.step = step.step;
    result.stop = step.stop;
    result.visible_px = witness.evidence().front().largest_px;
    result.view_point_m = to_goal.at(end_m, sim::DistanceField::kBaseSnap_m);
    result.path_m = path_m_ - begin.path_m;
    result.shortest_path_m = to_goal.at(begin.p_m, sim::DistanceField::kBaseSnap_m);
    sim::TrialEnd end;
    end.stopped = step.stop.has_value();
    end.declared = step.stop == core::StopReason::kGoalReached;
    end.view_point_m = result.view_point_m;
    end.visible_px = result.visible_px;
    end.path_m = result.path_m;
    end.shortest_path_m = result.shortest_path_m;
    result.success = sim::succeeded(wanted.profile, end);
    result.spl = sim::profile_spl(wanted.profile, end);
    return result;
  }

  BoundScript& bound_;
  const ScriptDriver& driver_;
  const std::map<std::string, sim::Episode>& goals_;
  core::Progress progress_;
  drawing::TrialScene scene_;
  std::optional<video::TrialVideo> video_;
  std::optional<trials::FrameRecorder> frames_;
  std::optional<glm::dvec2> last_m_;
  double path_m_ = 0.0;
  std::size_t begun_ = 0, ended_ = 0;
  std::vector<Begin> begins_;
  std::vector<FindResult> finds_;
};

DriverContext driver_context(const BoundScript& bound, const core::Detector& detector,
                             const std::map<std::string, sim::Episode>& goals) {
  DriverContext context;
  context.robot = bound.world.robot();
  context.places_m = bound.places_m;
  context.way_to = [&bound](const glm::dvec2& goal_m) -> nav::PathOracle {
    const std::array<glm::dvec2, 1> goals_m{goal_m};
    return [way = std::make_shared<sim::OracleWay>(bound.world, goals_m)](
               const glm::dvec2& from_m) { return way->from(from_m); };
  };
  context.searcher =
      [&bound, &detector, &goals,
       models = std::make_shared<trials::LoadedPolicyModels>()](const ScriptStep& step) {
        nav::PolicyContext policy;
        policy.class_names = detector.class_names();
        policy.robot = static_cast<const core::RobotBase&>(bound.world.robot());
        policy.models = models->loaders();
        policy.camera_height_m = bound.camera_height_m;
        if (step.policy.name() == "oracle-path") {
          policy.oracle = [way = std::make_shared<sim::OracleWay>(
                               bound.world, goals.at(step.category).view_points_m)](
                              const glm::dvec2& from_m) { return way->from(from_m); };
        }
        return step.policy.make(policy);
      };
  context.class_index = [&detector](const std::string& category) {
    const std::vector<std::string>& names = detector.class_names();
    const auto found = std::find(names.begin(), names.end(), category);
    return found == names.end() ? -1 : static_cast<int>(found - names.begin());
  };
  return context;
}

void write_ticks(const fs::path& file, const ScriptedResult& result) {
  core::write_file_atomically(file, [&](std::ostream& out) {
    out << "time_s,x_m,y_m,yaw_rad,v_mps,w_radps,step,contact,image,age_ms,hash\n";
    for (const sim::TickRecord& tick : result.trial.track) {
      out << core::print("%.3f,%.6f,%.6f,%.6f,%.4f,%.4f,", core::seconds(tick.time_ns),
                         tick.pose.x_m, tick.pose.y_m, tick.pose.yaw_rad,
                         tick.command.forward_mps, tick.command.turn_radps)
          << step_at(result.steps, tick.time_ns) + 1 << (tick.in_contact ? ",1," : ",0,")
          << tick.capture_index << core::print(",%.1f,", sim::ms_from_ns(tick.age_ns))
          << core::hex(tick.state_hash) << '\n';
    }
  });
}

void write_records(const BoundScript& bound, const ScriptedResult& result,
                   const fs::path& folder) {
  const ScriptedTrial& script = *bound.script;
  core::write_file_atomically(folder / "trial.json", [&](std::ostream& out) {
    out << to_json(script, result) << '\n';
  });
  if (script.record.topdown) {
    perception::write_image(folder / "trial.png", draw_script(bound, result));
  }
  if (script.record.ticks) write_ticks(folder / "ticks.csv", result);
  sim::GeoTrack track;
  track.name = script.title;
  for (const sim::TickRecord& tick : result.trial.track) {
    track.positions_m.emplace_back(tick.pose.x_m, tick.pose.y_m);
  }
  if (!track.positions_m.empty()) {
    sim::write_track_geojson(folder / "track.geojson", bound.world.local_frame(), track);
  }
}

}  // namespace

ScriptedResult run_script(BoundScript& bound, const fs::path& folder) {
  const ScriptedTrial& script = *bound.script;
  fs::create_directories(folder);
  std::map<std::string, sim::Episode> goals;
  sim::Episode episode;
  for (const ScriptStep& step : script.steps) {
    if (step.kind != StepKind::kFind) continue;
    if (!goals.contains(step.category)) goals[step.category] = places_of(bound, step.category);
    if (episode.class_name.empty()) episode.class_name = step.category;
  }
  episode.id = script.name;
  episode.start = bound.start;
  episode.seed = core::hash64(script.name, script.seed);

  const Eyes eyes = make_eyes(bound);
  ScriptDriver driver(script.steps, driver_context(bound, *eyes.detector, goals));
  Watcher watcher(bound, driver, goals, episode, eyes.detector->class_names(), folder);
  const sim::TickObserver observer = [&](const sim::TickRecord& tick, const core::Frame& frame,
                                         const std::vector<core::Detection>& detections,
                                         const core::Policy& policy) {
    watcher.see(tick, frame, detections, policy);
  };
  const sim::TrialOptions options = trial_options(bound);
  ScriptedResult result;
  result.trial = sim::run_trial({.episode = episode,
                                 .options = options,
                                 .world = bound.world,
                                 .robot = bound.world.robot(),
                                 .renderer = *bound.renderer,
                                 .detector = *eyes.detector,
                                 .policy = driver,
                                 .truth = eyes.truth,
                                 .observer = observer});
  result.steps = driver.records();
  result.finds = watcher.finish(result.trial);
  measure(bound, goals, result);
  write_records(bound, result, folder);
  if (options.sensors) {
    trials::write_sensor_files(folder / "sensors", *options.sensors, result.trial.sensors);
  }
  return result;
}

}  // namespace segsim::experiments::scripted_trials
