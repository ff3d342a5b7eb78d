#pragma once

/// @file
/// What a trial leaves in its work folder: video, recorded frames, sensor readings, picture,
/// track and log.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "experiments/drawing/trial_picture.h"
#include "experiments/specs/spec.h"
#include "experiments/trials/frame_recorder.h"
#include "experiments/trials/trial_runner.h"
#include "experiments/video/trial_video.h"

namespace segsim::experiments::trials {

/// "flat/potted plant/03" -> "flat/potted_plant-03.before", with "-r1" for the second
/// repetition: the files of a trial, without folder and ending.
[[nodiscard]] std::string file_stem(const TrialTask& task);

/// Of one trial; what it is given outlives it.
class TrialOutputs {
 public:
  /// Begins what is written tick by tick.
  /// @param renderer  Draws recorded frames once more.
  TrialOutputs(const specs::ExperimentSpec& spec, const TrialTask& task,
               const drawing::TrialScene& scene,
               const std::vector<std::string>& detector_classes, std::filesystem::path work,
               core::Renderer& renderer);

  void add(const sim::TickRecord& tick, const core::Frame& frame,
           const std::vector<core::Detection>& detections, const core::Policy& policy);

  /// Writes the rest, as far as the task wants a record, and enters the files in the row.
  /// @param distance_m  To the goal, by tick.
  void finish(const sim::TrialResult& result, const sim::TrialOptions& options,
              const records::TrialWitness& witness, std::vector<double> distance_m,
              records::TrialRow& row);

 private:
  [[nodiscard]] std::string video_file() const { return "videos/" + name_ + ".mp4"; }

  const specs::ExperimentSpec& spec_;
  const TrialTask& task_;
  const drawing::TrialScene& scene_;
  std::filesystem::path work_;
  std::string name_;
  std::optional<video::TrialVideo> video_;
  std::optional<FrameRecorder> frames_;
};

}  // namespace segsim::experiments::trials
