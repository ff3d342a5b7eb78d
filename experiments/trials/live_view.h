#pragma once

/// @file
/// What a worker is doing now, for `segsim serve`: one small file per worker beside the
/// results, replaced about twice a second while somebody watches, and never otherwise.
///
///     live/watched           touched by whoever watches; a worker looks at it once a second
///
///     live/HOST-ID-N.live    one line of JSON, then the bytes of the parts that it names:
///                            camera.jpg, panoptic.jpg, cells.png
///
/// One file holds it all, so that pictures and numbers are of the same tick. Nothing of it
/// reaches the trial; what it costs is held below 1 % of the worker's time.

#include <chrono>
#include <deque>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/render.h"
#include "core/stages.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::trials {

/// Folder of the files above, below that of the results.
inline constexpr const char* kLiveFolder = "live";
inline constexpr const char* kLiveMarker = "watched";
inline constexpr const char* kLiveEnding = ".live";
inline constexpr const char* kLiveSchema = "segsim.live/1";
/// After that long without a touch nobody watches any more.
inline constexpr double kWatchedFor_s = 10.0;

/// What does not change during a trial.
struct LiveTrial {
  std::string scene, scene_title, arm, episode, goal_class;
  int repetition = 0;
  int goal_index = -1;  ///< Of the goal among the detector's classes; -1: it has none.
  std::vector<std::string> detector_classes;
  std::filesystem::path bundle;  ///< Absolute.
  double time_limit_s = 0.0;
  core::Pose2 start;
  std::vector<glm::dvec2> shortest_path_m;
  std::vector<std::uint16_t> goal_instances{};  ///< If only some objects of the class are.
};

/// Writes the file of one worker. One object per thread.
class LiveView {
 public:
  /// @param results  Folder of the results; "live" in it is made when somebody watches.
  explicit LiveView(const std::filesystem::path& results);
  /// Removes the file.
  ~LiveView();
  LiveView(const LiveView&) = delete;
  LiveView& operator=(const LiveView&) = delete;

  void begin(LiveTrial trial);
  /// Once per tick. Does not throw: a folder that cannot be written to ends the show.
  void add(const sim::TickRecord& tick, const core::Frame& frame,
           std::span<const core::Detection> detections, const core::Policy& policy);

  /// Wall times of the stages of the tick to come, from the decorators below.
  void note_detect(double wall_ms) { pending_.detect_ms += wall_ms; }
  void note_policy(double wall_ms) { pending_.policy_ms += wall_ms; }

  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  /// Time spent on files since the beginning.
  [[nodiscard]] double spent_s() const { return spent_s_; }

 private:
  using Clock = std::chrono::steady_clock;
  /// Wall times of one tick.
  struct StageTimes {
    int tick = 0;
    double total_ms = 0, render_ms = 0, detect_ms = 0, policy_ms = 0;
    double age_ms = 0;  ///< Of the image in use, simulated.
  };
  [[nodiscard]] bool due(Clock::time_point now);
  [[nodiscard]] double watched_s() const;  ///< Since the first file.
  void write(const sim::TickRecord& tick, const core::Frame& frame,
             std::span<const core::Detection> detections, const core::PolicyView& view);
  [[nodiscard]] std::string header(
      const sim::TickRecord& tick, const core::Frame& frame,
      std::span<const core::Detection> detections, const core::PolicyView& view,
      const std::vector<std::pair<std::string, std::string>>& parts) const;

  std::filesystem::path marker_, file_;
  LiveTrial trial_;
  int ticks_ = 0;
  std::vector<std::pair<glm::dvec2, core::PolicyMode>> path_;
  std::deque<StageTimes> times_;
  StageTimes pending_;
  std::optional<Clock::time_point> last_tick_, first_write_;
  Clock::time_point next_look_, next_write_;
  bool watched_ = false, broken_ = false, written_ = false;
  double spent_s_ = 0.0;
};

/// Times the calls of another detector.
class TimedDetector final : public core::Detector {
 public:
  TimedDetector(core::Detector& inner, LiveView& live) : inner_(inner), live_(live) {}
  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return inner_.class_names();
  }
  [[nodiscard]] std::vector<core::Detection> detect(const core::Observation& seen) override;

 private:
  core::Detector& inner_;
  LiveView& live_;
};

/// Times the decisions of another policy.
class TimedPolicy final : public core::Policy {
 public:
  TimedPolicy(core::Policy& inner, LiveView& live) : inner_(inner), live_(live) {}
  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override {
    inner_.reset(goal, seed);
  }
  [[nodiscard]] core::Decision decide(const core::Observation& seen,
                                      std::span<const core::Detection> detections) override;
  [[nodiscard]] core::PolicyView view() const override { return inner_.view(); }

 private:
  core::Policy& inner_;
  LiveView& live_;
};

}  // namespace segsim::experiments::trials
