#pragma once

/// @file
/// The course of one trial, tick by tick, as a gzip file of JSON beside the results: what
/// `segsim explain` tells its story from. Some 30 bytes per tick.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/camera.h"
#include "experiments/records/failure_cause.h"
#include "experiments/records/trial_witness.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::records {

struct TrialLog {
  static constexpr const char* kSchema = "segsim.trial_log/1";

  std::string scene_title, arm;
  std::filesystem::path bundle;  ///< Folder; relative to the work folder if it lies below.
  core::CameraIntrinsics camera;
  double camera_height_m = 1.2, camera_pitch_down_rad = 0.0;
  int visible_px = 40;  ///< From so many pixels of one goal object on it is in view.
  double control_period_s = 0.1, time_limit_s = 0.0;
  std::optional<core::StopReason> stop_reason;
  sim::Episode episode;  ///< Without IoUs.
  std::vector<glm::dvec2> shortest_path_m;
  // Per tick.
  std::vector<sim::TickRecord> track;
  std::vector<TickEvidence> evidence;
  std::vector<double> distance_m;  ///< To the nearest view point; infinity off the floor.
  std::vector<JudgedDetection> detections;
  // The policy's map at the end, in World.
  std::vector<core::PolicyView::Object> objects;  ///< Of the goal's class.
  std::optional<glm::dvec2> target_m;
};

void write_trial_log(const std::filesystem::path& file, const TrialLog& log);
/// @throws core::InputError: no gzip, no JSON, another schema, columns of unequal length, an
/// unknown stop reason.
[[nodiscard]] TrialLog read_trial_log(const std::filesystem::path& file);

}  // namespace segsim::experiments::records
