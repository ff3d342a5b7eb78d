#pragma once

/// @file
/// Plays a latency budget: a discrete-event simulation of the robot's computer.
///
///     capture --(latency)--> detect --> segment --> map ==> result       (one line per image)
///     tick ==> policy --> actuate ==> command in effect                  (one line per tick)
///
/// Jobs are not interrupted. When a server of a resource is free, the job of the oldest image
/// (or tick) that waits for it goes first, so what was begun is finished before something new
/// begins; among equals the budget's order decides. Each stage has a queue of its own
/// (QueueRule). An image that one queue gives up is lost as a whole. Events of the same
/// instant are all taken in before a free server chooses.

#include <cstdint>
#include <functional>
#include <map>
#include <queue>
#include <string>
#include <vector>

#include "core/stages.h"
#include "sim/time/latency_budget.h"
#include "sim/time/timing.h"

namespace segsim::sim {

class Schedule {
 public:
  /// Does what a job stands for when it starts; returns how long that takes in simulated
  /// time. `index` counts captures (for the policy and actuation: ticks).
  using Work = std::function<core::TimeNs(const StageBudget& stage, std::uint64_t index)>;

  /// An image all of whose stages are done.
  struct Result {
    std::uint64_t index = 0;
    core::TimeNs capture_ns = 0, done_ns = 0;
  };
  /// The moment at which the command of a tick reaches the wheels.
  struct Effect {
    std::uint64_t tick = 0;
    core::TimeNs time_ns = 0;
  };

  /// @param budget  Without a problem(). Stages charged to sim are not played.
  Schedule(LatencyBudget budget, Work work);

  /// An image is taken at that time. Not before what was already played; indices ascend. What
  /// happens at this very moment should not have been played either (advance_to one nanosecond
  /// less), or a server that becomes free now chooses without this image.
  void capture(core::TimeNs time_ns, std::uint64_t index);
  /// The policy starts on the tick as soon as its resource is free. Only if not deciding().
  void decide(core::TimeNs time_ns, std::uint64_t tick);
  [[nodiscard]] bool deciding() const { return deciding_; }

  /// For Work: when the job begins whose duration it is asked for.
  [[nodiscard]] core::TimeNs job_begins_ns() const { return job_begins_ns_; }

  /// Plays everything up to and including that time.
  void advance_to(core::TimeNs time_ns);

  // What happened since the last call, in order of time.
  [[nodiscard]] std::vector<Result> take_results() { return std::exchange(results_, {}); }
  [[nodiscard]] std::vector<Effect> take_effects() { return std::exchange(effects_, {}); }
  /// Captures that were given up.
  [[nodiscard]] std::vector<std::uint64_t> take_dropped() {
    return std::exchange(dropped_, {});
  }

  /// Stages and resources of the report. Jobs in flight have no response yet, but the whole
  /// time that they will take is in their resource's busy_ns, which can so exceed the span.
  void report(TimingReport& report) const;

 private:
  enum class Line : std::uint8_t { kImage, kTick };
  struct Job {
    core::TimeNs origin_ns = 0;  ///< Capture or tick.
    Line line = Line::kImage;
    std::size_t stage = 0;
    std::uint64_t index = 0;
    core::TimeNs release_ns = 0;
    // Who goes first. NOLINTNEXTLINE(modernize-use-nullptr): it means the 0 of <=>.
    auto operator<=>(const Job&) const = default;
  };
  struct Event {
    core::TimeNs time_ns = 0;
    std::uint64_t order = 0;  ///< Of creation: equal times keep it.
    enum class Kind : std::uint8_t { kRelease, kEnd } kind = Kind::kRelease;
    Job job;
    bool operator>(const Event& other) const {
      return time_ns != other.time_ns ? time_ns > other.time_ns : order > other.order;
    }
  };
  struct Image {
    core::TimeNs capture_ns = 0;
    std::vector<int> waits_for;  ///< By stage: predecessors that are not done.
    int stages_left = 0;
  };
  struct Server {
    int count = 1, busy = 0;
  };

  void push(core::TimeNs time_ns, Event::Kind kind, const Job& job);
  void release(const Job& job, core::TimeNs now_ns);
  void start(const Job& job, core::TimeNs now_ns);
  void dispatch(core::TimeNs now_ns);
  void end(const Job& job, core::TimeNs now_ns);
  void end_of_image_stage(const Job& job, core::TimeNs now_ns);
  void end_of_tick_stage(const Job& job, core::TimeNs now_ns);
  void image_ready(std::uint64_t index, core::TimeNs now_ns);
  void enqueue(const Job& job);
  void give_up(const Job& job);
  [[nodiscard]] std::size_t stage_index(const std::string& name) const;
  [[nodiscard]] std::size_t stage_index(StageRole role) const {
    return stage_index(to_string(role));
  }

  LatencyBudget budget_;  ///< Stages of the robot only.
  Work work_;
  std::size_t capture_, policy_, actuate_;      ///< Into budget_.stages; kNone if absent.
  std::vector<std::vector<std::size_t>> next_;  ///< By stage: those that wait for it.
  std::vector<int> predecessors_;               ///< By stage: their number.
  std::vector<std::size_t> first_;              ///< Stages that start with the image.
  int image_stages_ = 0;
  std::vector<std::vector<Job>> waiting_;  ///< By stage, in order of release.
  std::map<std::string, Server> servers_;
  std::map<std::uint64_t, Image> images_;  ///< In flight.
  std::priority_queue<Event, std::vector<Event>, std::greater<>> events_;
  std::uint64_t events_made_ = 0;
  core::TimeNs now_ns_ = 0, job_begins_ns_ = 0;
  bool deciding_ = false;
  std::vector<Result> results_;
  std::vector<Effect> effects_;
  std::vector<std::uint64_t> dropped_;
  std::vector<StageTiming> timings_;  ///< By stage.
  std::map<std::string, ResourceTiming> usage_;
};

}  // namespace segsim::sim
