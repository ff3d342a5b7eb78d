#include "sim/trial/internal/robot_computer.h"

namespace segsim::sim::internal {

RobotComputer::RobotComputer(const TrialOptions& options, std::uint64_t episode_seed,
                             TrialEye& eye)
    : options_(options),
      seed_(episode_seed),
      eye_(eye),
      budget_(options.clock.played_budget()),
      schedule_(budget_, [this](const StageBudget& stage, std::uint64_t index) {
        return work(stage, index);
      }) {}

core::TimeNs RobotComputer::work(const StageBudget& stage, std::uint64_t index) {
  core::TimeNs measured_ns = 0;
  int items = 0;
  const StageRole role = stage.role();
  if (role == StageRole::kPolicy) {
    measured_ns = policy_ns_;
  } else if (role != StageRole::kActuate) {
    Capture& capture = eye_.at(index);
    if (role == StageRole::kDetect) {
      (void)eye_.detections_of(capture);
      measured_ns = capture.detect_ns;
    } else if (role == StageRole::kRender) {
      measured_ns = capture.render_ns;
    }
    items = static_cast<int>(capture.detections.size());
  }
  // In both modes that measure. In realtime a factor makes the robot's computer slower than
  // this one, and the world still keeps to the wall clock.
  const auto scaled_ns = static_cast<core::TimeNs>(static_cast<double>(measured_ns) *
                                                   options_.clock.measured_scale);
  const core::TimeNs duration_ns =
      stage.duration.draw(stage.name, seed_, index, items, scaled_ns) +
      options_.faults.added_ns(stage.name, schedule_.job_begins_ns());
  trace_.add(stage.name, index, duration_ns);
  return duration_ns;
}

void RobotComputer::decided(core::TimeNs now_ns, std::uint64_t tick,
                            core::TimeNs measured_ns) {
  policy_ns_ = measured_ns;
  schedule_.decide(now_ns, tick);
}

std::vector<Schedule::Effect> RobotComputer::compute_until(core::TimeNs time_ns) {
  schedule_.advance_to(time_ns);
  for (const std::uint64_t index : schedule_.take_dropped()) eye_.dropped(index);
  for (const Schedule::Result& done : schedule_.take_results()) eye_.ready(done.index);
  return schedule_.take_effects();
}

}  // namespace segsim::sim::internal
