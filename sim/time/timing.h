#pragma once

/// @file
/// What the stages of a trial took: percentiles, missed deadlines, drops, ages. Reports of
/// several trials can be added up.

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/stages.h"

namespace segsim::sim {

/// Durations [ns] and their summary. Percentiles are values that occurred (nearest rank).
class DurationSamples {
 public:
  void add(core::TimeNs value_ns) { values_ns_.push_back(value_ns); }
  void append(const DurationSamples& other);
  [[nodiscard]] int count() const { return static_cast<int>(values_ns_.size()); }
  /// The smallest value that at least `share` of all do not exceed; 0 if there are none.
  [[nodiscard]] core::TimeNs percentile(double share) const;
  [[nodiscard]] core::TimeNs max() const { return percentile(1.0); }
  [[nodiscard]] const std::vector<core::TimeNs>& values_ns() const { return values_ns_; }

 private:
  std::vector<core::TimeNs> values_ns_;
};

/// One stage: from release (its input is there) to its end, so waiting counts.
struct StageTiming {
  std::string name;
  DurationSamples response;
  core::TimeNs deadline_ns = 0;
  int misses = 0, longest_miss_run = 0;
  int drops = 0;  ///< Jobs that a full queue gave up.

  /// @return  Whether the deadline was missed.
  bool add(core::TimeNs response_ns);
  void append(const StageTiming& other);

 private:
  int run_ = 0;
};

struct ResourceTiming {
  int servers = 1;
  core::TimeNs busy_ns = 0;  ///< Sum over jobs that began, each with all of its time.
};

/// Of one trial, or of several.
struct TimingReport {
  std::vector<StageTiming> stages;  ///< In the budget's order; only those of the robot.
  StageTiming end_to_end;           ///< Capture of the image to its command in effect.
  DurationSamples age;  ///< At each tick with an image in use: tick time - capture time.
  std::map<std::string, ResourceTiming> resources;
  core::TimeNs span_ns = 0;     ///< Simulated time.
  int ticks_without_image = 0;  ///< Before the first result.
  int ticks_without_news = 0;   ///< Ticks at which no new image was there to decide on.
  int overruns = 0;             ///< Realtime only: ticks that the program was late for.

  [[nodiscard]] const StageTiming* find(const std::string& stage) const;
  /// Share of the time that the resource's servers worked.
  [[nodiscard]] double utilisation(const std::string& resource) const;
  void append(const TimingReport& other);
};

}  // namespace segsim::sim
