#pragma once

/// @file
/// What the robot's computer would need: stages, the resources they run on, how long each
/// takes, and what happens when it is late. A budget is data only; sim/time/schedule.h plays
/// it.
///
/// Two costs are kept apart. `Charge::kRobot` would exist on the robot too (detector, map,
/// planner) and delays it in simulated time; `Charge::kSim` (rendering, judging, logs) costs
/// the experimenter's time only.

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/stages.h"
#include "sim/time/stage_role.h"

namespace segsim::sim {

[[nodiscard]] constexpr core::TimeNs ns_from_ms(double ms) {
  return static_cast<core::TimeNs>(ms * 1e6 + (ms < 0.0 ? -0.5 : 0.5));
}
[[nodiscard]] constexpr double ms_from_ns(core::TimeNs ns) {
  return static_cast<double>(ns) * 1e-6;
}

enum class Charge : std::uint8_t { kRobot, kSim };

/// Which of the waiting jobs of one stage give way when its queue is full.
enum class QueueRule : std::uint8_t {
  kNewest,   ///< The oldest one that waits: the newest wins.
  kFifo,     ///< The newcomer; deep by default, so that nearly all are worked on in order.
  kDropNew,  ///< The newcomer.
};

/// What becomes of a command that is later than its deadline. A miss is counted in any case.
enum class OnMiss : std::uint8_t {
  kUseStale,     ///< It takes effect when it is ready.
  kDrop,         ///< It is thrown away; without another one the base runs into its timeout.
  kHold,         ///< The last command is sent again in its place.
  kZeroCommand,  ///< The base is told to stop in its place.
  kAbort,        ///< The trial ends (Outcome::kAborted).
};
[[nodiscard]] const char* to_string(Charge charge);
[[nodiscard]] const char* to_string(QueueRule rule);
[[nodiscard]] const char* to_string(OnMiss rule);

/// Recorded durations: per stage, (index of the capture or tick, duration), ascending index.
class LatencyTrace {
 public:
  void add(const std::string& stage, std::uint64_t index, core::TimeNs duration_ns);
  /// The duration recorded under that index; for an index that was not recorded the
  /// (index mod n)-th of the n recorded ones, so that a trace can be longer or shorter than a
  /// trial. The stage must be there.
  [[nodiscard]] core::TimeNs at(const std::string& stage, std::uint64_t index) const;
  [[nodiscard]] bool has(const std::string& stage) const { return stages_.contains(stage); }
  [[nodiscard]] bool empty() const { return stages_.empty(); }
  using Entries = std::vector<std::pair<std::uint64_t, core::TimeNs>>;
  [[nodiscard]] const std::map<std::string, Entries>& stages() const { return stages_; }
  bool operator==(const LatencyTrace&) const = default;

 private:
  std::map<std::string, Entries> stages_;
};

struct DurationModel {
  enum class Kind : std::uint8_t {
    kConstant,   ///< a
    kLognormal,  ///< Median a, 95th percentile b.
    kNormal,     ///< Mean a, standard deviation b, cut at 0.
    kUniform,    ///< Between a and b.
    kTrace,      ///< `trace`
    kMeasured,   ///< What this machine took.
  };
  Kind kind = Kind::kConstant;
  double a_ms = 0.0, b_ms = 0.0;
  std::shared_ptr<const LatencyTrace> trace;
  double per_item_ms = 0.0;  ///< Added for each detection of the frame.
  double added_ms = 0.0;     ///< Added to every duration: what a sweep turns.

  /// Duration of one job, >= 0. Equal arguments give equal durations: the stream is keyed by
  /// the episode's seed, the stage and the index, so that a delay elsewhere shifts no draw.
  /// @param measured_ns  What kMeasured returns (per item and added time on top).
  [[nodiscard]] core::TimeNs draw(const std::string& stage, std::uint64_t episode_seed,
                                  std::uint64_t index, int items,
                                  core::TimeNs measured_ns = 0) const;
};

/// One stage. Three roles have a place of their own: kCapture, kPolicy and kActuate (the first
/// and the last overlap with themselves, so they run on no resource). All others work on
/// images, in the order of `after`. The program itself runs kDetect.
struct StageBudget {
  std::string name;
  Charge charge = Charge::kRobot;
  std::string on;                  ///< Resource; empty: a pure delay.
  std::vector<std::string> after;  ///< All of these come first; empty: "capture".
  DurationModel duration;
  core::TimeNs deadline_ns = 0;  ///< From release to end; 0: none.
  QueueRule queue = QueueRule::kNewest;
  int queue_depth = 1;

  [[nodiscard]] StageRole role() const { return stage_role(name); }
};

struct LatencyBudget {
  std::string id;
  std::map<std::string, int> resources;  ///< Servers of each.
  std::vector<StageBudget> stages;
  core::TimeNs end_to_end_deadline_ns = 0;  ///< Capture to command in effect; 0: none.
  OnMiss on_miss = OnMiss::kUseStale;
  core::TimeNs max_age_ns = 0;  ///< Of the image in use at a tick; 0: any.
  OnMiss on_max_age = OnMiss::kZeroCommand;

  [[nodiscard]] const StageBudget* find(const std::string& stage) const;
  [[nodiscard]] StageBudget* find(const std::string& stage);
  /// "" or what is wrong: a name twice, an unknown resource or predecessor, a cycle, a stage
  /// in a place where it cannot be.
  [[nodiscard]] std::string problem() const;
};

/// The budget with the durations of a recorded trial in place of its own, for the stages that
/// the trace has.
[[nodiscard]] LatencyBudget with_trace(LatencyBudget budget,
                                       const std::shared_ptr<const LatencyTrace>& trace);

}  // namespace segsim::sim
