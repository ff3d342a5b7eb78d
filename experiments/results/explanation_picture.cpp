// Pictures of a trial's story.
#include <algorithm>
#include <cstdio>
#include <limits>
#include <map>
#include <optional>

#include "core/error.h"
#include "experiments/drawing/box_picture.h"
#include "experiments/drawing/goal_boxes.h"
#include "experiments/drawing/trial_picture.h"
#include "experiments/records/row_words.h"
#include "experiments/results/explanation.h"

namespace segsim::experiments::results {
namespace {

std::string moment_caption(const records::TrialLog& log, std::size_t number,
                           const KeyMoment& moment) {
  char text[160];
  std::snprintf(text, sizeof text, "%zu  %.1f s  %s", number,
                core::seconds(log.track[static_cast<std::size_t>(moment.tick)].time_ns),
                moment.what.c_str());
  return text;
}

}  // namespace

core::Image<core::Rgb8> draw_story_map(const records::TrialRow& trial,
                                       const records::TrialLog& log,
                                       const core::SceneManifest& manifest,
                                       const drawing::FloorPlan& plan) {
  const std::optional<sim::Outcome> outcome = simulated(trial.outcome);
  if (!outcome)
    throw core::InputError::expected("trial " + std::to_string(trial.trial_id),
                                     "a trial that was run", to_string(trial.outcome));
  sim::TrialResult result;
  result.outcome = *outcome;
  result.success = trial.success;
  result.spl = trial.spl;
  result.path_m = trial.path_m;
  result.shortest_path_m = trial.shortest_path_m;
  result.sim_s = trial.sim_s;
  result.contacts = trial.contacts;
  result.distance_to_goal_m =
      trial.distance_to_goal_m.value_or(std::numeric_limits<double>::infinity());
  result.track = log.track;
  result.final_view.objects = log.objects;
  result.final_view.target_m = log.target_m;

  drawing::TrialScene scene;
  scene.plan = &plan;
  scene.manifest = &manifest;
  scene.episode = &log.episode;
  scene.scene_title = log.scene_title;
  scene.arm = log.arm;
  scene.goal_index = 0;  // The log keeps objects of the goal's class alone.
  scene.shortest_path_m = log.shortest_path_m;
  if (!trial.success) scene.cause = records::word_of(trial.why.cause);
  std::size_t number = 0;
  for (const KeyMoment& moment : key_moments(trial, log)) {
    const core::Pose2& pose = log.track[static_cast<std::size_t>(moment.tick)].pose;
    scene.marks.push_back({{pose.x_m, pose.y_m}, std::to_string(++number)});
  }
  return drawing::draw_trial(scene, result);
}

core::Image<core::Rgb8> draw_story_frames(const records::TrialRow& trial,
                                          const records::TrialLog& log,
                                          const core::SceneManifest& manifest,
                                          core::Renderer& renderer) {
  constexpr int kColumns = 3;
  const sim::GoalObjects goal(manifest, log.episode);
  const auto T_robot_camera =
      core::mast_camera(log.camera_height_m, log.camera_pitch_down_rad);
  core::Frame frame;
  std::vector<drawing::SheetPicture> pictures;
  for (const KeyMoment& moment : key_moments(trial, log)) {
    const core::Pose2& pose = log.track[static_cast<std::size_t>(moment.tick)].pose;
    renderer.render(core::transform_from_pose2<core::frame::World>(pose) * T_robot_camera,
                    log.camera, core::Channels::kRgb | core::Channels::kLabels, frame);
    std::vector<core::Detection> detections;
    for (const records::JudgedDetection& d : log.detections) {
      if (d.tick == moment.tick) detections.push_back({0, d.score, d.box});
    }
    const double scale = std::max(1.0, 480.0 / log.camera.width_px);
    pictures.push_back({drawing::draw_boxes(frame.rgb, drawing::goal_boxes(frame, goal),
                                            detections, {log.episode.goal_name()}, scale),
                        moment_caption(log, pictures.size() + 1, moment)});
  }
  const int columns = std::clamp(static_cast<int>(pictures.size()), 1, kColumns);
  return drawing::picture_sheet(
      pictures, columns,
      "Find " + sim::with_article(log.episode.goal_name()) + "  /  " + trial.episode +
          "  /  arm " + trial.arm + "  /  " +
          (trial.success ? "success" : records::word_of(trial.why.cause)));
}

}  // namespace segsim::experiments::results
