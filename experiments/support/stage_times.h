#pragma once

/// @file
/// How long each stage of a run took on the wall clock, and which were skipped because their
/// results were there.

#include <chrono>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace segsim::experiments::support {

struct StageTime {
  std::string stage;    ///< "fine-tuning", "reconstruction/flat-3".
  double wall_s = 0.0;  ///< 0 of what was there.
  bool made = false;    ///< Something was made, not only found.
};

/// Of one process. Stages may be timed side by side, each from a thread of its own.
class StageTimes {
 public:
  using Clock = std::chrono::steady_clock;

  /// Measures from its making to its end. Several of a stage at a time measure from the first
  /// one's making to the last one's end.
  class Timer {
   public:
    Timer(StageTimes& times, std::string stage);
    ~Timer();
    Timer(const Timer&) = delete;
    Timer& operator=(const Timer&) = delete;
    /// The stage does its work now, and does not only find that it is done. May be called by
    /// several threads.
    void working();

   private:
    StageTimes& times_;
    std::string stage_;
  };

  /// In the order in which they began; repeated stages are one, with their times added.
  [[nodiscard]] std::vector<StageTime> all() const;

 private:
  /// A stage, and whether it goes on.
  struct Stage {
    StageTime time;
    int timers = 0;
    Clock::time_point start;  ///< Of the first of these timers.
  };
  Stage& stage(const std::string& name);

  mutable std::mutex mutex_;
  std::vector<Stage> stages_;
};

/// "12.3 s", or "0 s (was there)".
[[nodiscard]] std::string in_words(const StageTime& time);
/// A line per stage and one for all, whose wall time is `total_s`: stages may overlap.
[[nodiscard]] std::string stage_times_text(const std::vector<StageTime>& times,
                                           double total_s);

/// What a run that already has `known` ("time/<stage>" of RunRow::provenance) gets after these
/// stages: what was made is added to what earlier calls made; what was there replaces nothing.
[[nodiscard]] std::map<std::string, std::string> stage_time_rows(
    const std::vector<StageTime>& times, const std::map<std::string, std::string>& known);

}  // namespace segsim::experiments::support
