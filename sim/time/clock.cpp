#include "sim/time/clock.h"

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim {
namespace {

using Steady = std::chrono::steady_clock;

StageBudget measured_stage(StageRole role, const char* resource) {
  StageBudget stage;
  stage.name = to_string(role);
  stage.on = resource;
  stage.duration.kind = DurationModel::Kind::kMeasured;
  return stage;
}

}  // namespace

const char* to_string(ClockMode mode) {
  constexpr const char* kNames[] = {"lockstep", "virtual", "measured", "realtime"};
  return kNames[static_cast<std::size_t>(mode)];
}

core::TimeNs SensorRate::time_of(std::uint64_t index, std::uint64_t episode_seed) const {
  SEGSIM_CHECK(period_ns > 0 && jitter_ns >= 0 && 2 * jitter_ns < period_ns, "sensor rate");
  core::TimeNs time_ns = phase_ns + static_cast<core::TimeNs>(index) * period_ns;
  if (jitter_ns > 0) {
    core::RandomStream random(episode_seed, "camera_jitter", index);
    const auto reach = static_cast<double>(jitter_ns);
    time_ns += static_cast<core::TimeNs>(random.uniform(-reach, reach));
  }
  return std::max<core::TimeNs>(0, time_ns);
}

LatencyBudget TrialClock::played_budget() const {
  if (mode == ClockMode::kLockstep) return {};
  LatencyBudget played = budget;
  if (!measures()) return played;
  if (played.stages.empty()) {
    played.resources = {{"gpu", 1}, {"cpu", 1}};
    played.stages = {measured_stage(StageRole::kDetect, "gpu"),
                     measured_stage(StageRole::kPolicy, "cpu")};
  }
  for (StageBudget& stage : played.stages) {
    const StageRole role = stage.role();
    const bool timed =
        role == StageRole::kDetect || role == StageRole::kPolicy || role == StageRole::kRender;
    if (timed) stage.duration.kind = DurationModel::Kind::kMeasured;
    if (mode == ClockMode::kRealtime) stage.charge = Charge::kRobot;  // All of it takes time.
  }
  return played;
}

Pacer::Pacer()
    : Pacer(
          [] {
            return std::chrono::duration_cast<std::chrono::nanoseconds>(
                       Steady::now().time_since_epoch())
                .count();
          },
          [](core::TimeNs until_ns) {
            std::this_thread::sleep_until(
                Steady::time_point(std::chrono::duration_cast<Steady::duration>(
                    std::chrono::nanoseconds(until_ns))));
          }) {}

Pacer::Pacer(Now now, SleepUntil sleep_until)
    : now_(std::move(now)), sleep_until_(std::move(sleep_until)) {}

core::TimeNs Pacer::wait_until(core::TimeNs simulated_ns) {
  const core::TimeNs now_ns = now_();
  if (!start_ns_) start_ns_ = now_ns - simulated_ns;
  const core::TimeNs due_ns = *start_ns_ + simulated_ns;
  if (now_ns > due_ns) return now_ns - due_ns;
  sleep_until_(due_ns);
  return 0;
}

}  // namespace segsim::sim
