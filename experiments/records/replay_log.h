#pragma once

/// @file
/// What a trial leaves for `segsim replay`: the spec, the detections of every image, every
/// tick, and how long everything took. One JSON object per line:
///
///     {"schema": "segsim.replay/1", "spec": TEXT, "scene": ..., "arm": ..., ...}
///     {"image": 3, "detections": [[class, score, x0, y0, x1, y1], ...]}      per detector
///     call
///     {"tick": 0, "time_ns": 0, "pose": [x, y, yaw], "command": [v, w], ...}      per tick
///     {"trace": {"detect": [[index, duration_ns], ...], ...}}
///     {"timing": {...}}
///     {"sensors": {"imu": [readings, hash], ...}}            if the spec has sensors
///     {"result": {"outcome": ..., ...}}
///
/// With images, <file without .jsonl>.images/ holds depth and labels of each render call.

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/stages.h"
#include "experiments/records/trial_row.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::records {

struct ReplayLog {
  static constexpr const char* kSchema = "segsim.replay/1";

  std::string spec_text, spec_file;
  std::string scene, arm, episode;
  int repetition = 0;
  std::string scene_sha256, code_version;
  std::string clock_mode;
  std::vector<std::string> class_names;  ///< Of the detector.
  bool images = false;
  std::map<std::uint64_t, std::vector<core::Detection>> detections;  ///< By capture.
  std::vector<sim::TickRecord> ticks;
  sim::LatencyTrace trace;
  sim::TimingReport timing;
  std::vector<sim::SensorLog::Digest> sensors;
  sim::Outcome outcome = sim::Outcome::kTimeout;
  std::uint64_t state_hash = 0;
};

/// The log with what came out in the end.
[[nodiscard]] ReplayLog with_result(ReplayLog log, const sim::TrialResult& result);

void write_replay_log(const std::filesystem::path& file, const ReplayLog& log);
/// @throws core::InputError with file and line.
[[nodiscard]] ReplayLog read_replay_log(const std::filesystem::path& file);
/// That of a stored trial, which may not be there; empty for a trial without outputs.
/// @param work  Folder of the run.
[[nodiscard]] std::filesystem::path replay_log_of(const std::filesystem::path& work,
                                                  const TrialRow& trial);
/// The folder of the images that belong to a log.
[[nodiscard]] std::filesystem::path replay_images(const std::filesystem::path& log_file);

/// Where two trials part.
struct Divergence {
  int tick = -1;      ///< -1: nowhere.
  std::string field;  ///< "pose", "image", "detections", "command", "mode", "ticks", ...
  std::string recorded, replayed;
};
/// The first tick, and in it the first field, in which they differ.
[[nodiscard]] Divergence first_divergence(const std::vector<sim::TickRecord>& recorded,
                                          const std::vector<sim::TickRecord>& replayed);

/// The name of the first sensor whose readings differ; empty if there is none.
[[nodiscard]] std::string first_differing_sensor(
    const std::vector<sim::SensorLog::Digest>& recorded,
    const std::vector<sim::SensorLog::Digest>& replayed);

/// Passes a detector's answers on and keeps them.
class RecordingDetector final : public core::Detector {
 public:
  RecordingDetector(core::Detector& inner, ReplayLog& log) : inner_(inner), log_(log) {
    log.class_names = inner.class_names();
  }
  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return inner_.class_names();
  }
  [[nodiscard]] std::vector<core::Detection> detect(const core::Observation& seen) override;

 private:
  core::Detector& inner_;
  ReplayLog& log_;
};

/// Answers what was recorded. @throws core::InputError for an image that was not.
class ReplayDetector final : public core::Detector {
 public:
  explicit ReplayDetector(const ReplayLog& log) : log_(log) {}
  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return log_.class_names;
  }
  [[nodiscard]] std::vector<core::Detection> detect(const core::Observation& seen) override;

 private:
  const ReplayLog& log_;
};

/// Passes a renderer's images on and keeps depth and labels as OpenEXR files.
class RecordingRenderer final : public core::Renderer {
 public:
  RecordingRenderer(core::Renderer& inner, std::filesystem::path folder);
  using core::Renderer::render;
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              core::Channels channels, core::Frame& frame) override;

 private:
  core::Renderer& inner_;
  std::filesystem::path folder_;
  int calls_ = 0;
};

/// Gives out the recorded images, in the order of the calls; colours are black.
/// @throws core::InputError for a call too many.
class ReplayRenderer final : public core::Renderer {
 public:
  explicit ReplayRenderer(std::filesystem::path folder) : folder_(std::move(folder)) {}
  using core::Renderer::render;
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              core::Channels channels, core::Frame& frame) override;

 private:
  std::filesystem::path folder_;
  int calls_ = 0;
};

}  // namespace segsim::experiments::records
