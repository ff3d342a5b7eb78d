#include "experiments/trials/internal/trial_outputs.h"

#include <algorithm>
#include <cmath>

#include "experiments/records/trial_log.h"
#include "experiments/trials/sensor_files.h"
#include "perception/data/image_file.h"
#include "sim/ground/geodesy.h"

namespace segsim::experiments::trials {
namespace {

namespace fs = std::filesystem;

constexpr double kVideoSpeed = 2.0;  // Twice as fast as simulated time.

/// GeoJSON and KML. @return  The GeoJSON's path relative to `work`.
std::string write_track(const fs::path& work, const std::string& name, const TrialTask& task,
                        const sim::TrialResult& result) {
  sim::GeoTrack track;
  track.name = task.episode->id + " (" + task.arm->name + ")";
  for (const sim::TickRecord& tick : result.track) {
    track.positions_m.emplace_back(tick.pose.x_m, tick.pose.y_m);
  }
  if (track.positions_m.empty()) return {};
  const sim::DistanceField to_goal =
      task.scene->world.distance_to(task.episode->view_points_m);
  const std::vector<glm::dvec2> way =
      to_goal.path_from({task.episode->start.x_m, task.episode->start.y_m});
  if (!way.empty()) track.goal_m = way.back();
  track.properties = {{"goal", task.episode->goal_name()},
                      {"arm", task.arm->name},
                      {"outcome", sim::to_string(result.outcome)}};
  const std::string stem = "tracks/" + name;
  sim::write_track_geojson(work / (stem + ".geojson"), task.scene->world.local_frame(), track);
  sim::write_track_kml(work / (stem + ".kml"), task.scene->world.local_frame(), track);
  return stem + ".geojson";
}

records::TrialLog make_log(const drawing::TrialScene& scene, const sim::TrialOptions& options,
                           const LoadedScene& loaded, const fs::path& work,
                           const sim::TrialResult& result,
                           const records::TrialWitness& witness,
                           std::vector<double> distance_m) {
  records::TrialLog log;
  log.scene_title = scene.scene_title;
  log.arm = scene.arm;
  // A work folder may be moved with all that lies in it.
  const fs::path below =
      fs::absolute(loaded.bundle.folder).lexically_relative(fs::absolute(work));
  const bool inside = !below.empty() && *below.begin() != "..";
  log.bundle = inside ? below : fs::absolute(loaded.bundle.folder).lexically_normal();
  log.camera = options.camera;
  log.camera_height_m = options.camera_height_m;
  log.camera_pitch_down_rad = options.camera_pitch_down_rad;
  log.visible_px = options.visible_pixels;
  log.control_period_s = options.control_period_s;
  log.time_limit_s = options.time_limit_s;
  log.stop_reason = result.stop_reason;
  log.episode = *scene.episode;
  log.shortest_path_m = scene.shortest_path_m;
  log.track = result.track;
  log.evidence = witness.evidence();
  log.evidence.resize(log.track.size());  // The last ticks may have seen nothing new.
  log.distance_m = std::move(distance_m);
  log.detections = witness.detections();
  for (const core::PolicyView::Object& object : result.final_view.objects) {
    if (object.class_index != scene.goal_index) continue;
    log.objects.push_back(object);
    log.objects.back().position_m = records::world_from_odom(result, object.position_m);
  }
  if (result.final_view.target_m) {
    log.target_m = records::world_from_odom(result, *result.final_view.target_m);
  }
  return log;
}

}  // namespace

std::string file_stem(const TrialTask& task) {
  std::string stem = task.episode->id;
  std::replace(stem.begin(), stem.end(), ' ', '_');
  const std::size_t last = stem.rfind('/');
  if (last != std::string::npos && stem.find('/') != last) stem[last] = '-';
  if (task.repetition > 0) stem += "-r" + std::to_string(task.repetition);
  return stem + "." + task.arm->name;
}

TrialOutputs::TrialOutputs(const specs::ExperimentSpec& spec, const TrialTask& task,
                           const drawing::TrialScene& scene,
                           const std::vector<std::string>& detector_classes, fs::path work,
                           core::Renderer& renderer)
    : spec_(spec), task_(task), scene_(scene), work_(std::move(work)), name_(file_stem(task)) {
  if (task.video) {
    video_.emplace(work_ / video_file(), scene, detector_classes,
                   kVideoSpeed / spec.control_period_s);
  }
  if (task.frames) {
    const double ticks = std::round(spec.frames.every_s / spec.control_period_s);
    frames_.emplace(work_ / "frames" / name_, task.scene->bundle,
                    std::max(1, static_cast<int>(ticks)), renderer);
  }
  if (task.viewer != nullptr) task.viewer->begin(scene, detector_classes);
}

void TrialOutputs::add(const sim::TickRecord& tick, const core::Frame& frame,
                       const std::vector<core::Detection>& detections,
                       const core::Policy& policy) {
  if (video_) video_->add(tick, frame, detections, policy.view());
  if (task_.viewer != nullptr) task_.viewer->add(tick, frame, detections, policy.view());
  if (frames_) frames_->add(tick, frame);
}

void TrialOutputs::finish(const sim::TrialResult& result, const sim::TrialOptions& options,
                          const records::TrialWitness& witness, std::vector<double> distance_m,
                          records::TrialRow& row) {
  if (video_) {
    video_->finish(result);
    row.video = video_file();
  }
  if (task_.viewer != nullptr) task_.viewer->finish(result);
  if (frames_) frames_->finish();
  if (!task_.record) return;
  if (options.sensors) {
    write_sensor_files(work_ / "sensors" / name_, *options.sensors, result.sensors);
  }
  if (spec_.pictures) {
    row.picture = "pictures/" + name_ + ".png";
    perception::write_image(work_ / row.picture, drawing::draw_trial(scene_, result));
  }
  row.track = write_track(work_, name_, task_, result);
  row.log = "logs/" + name_ + ".json.gz";
  records::write_trial_log(work_ / row.log, make_log(scene_, options, *task_.scene, work_,
                                                     result, witness, std::move(distance_m)));
}

}  // namespace segsim::experiments::trials
