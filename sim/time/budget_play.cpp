#include "sim/time/budget_play.h"

#include <map>
#include <optional>

#include "core/check.h"
#include "sim/time/schedule.h"

namespace segsim::sim {

TimingReport play_budget(const TrialClock& clock, const BudgetPlayOptions& options) {
  SEGSIM_CHECK(options.control_period_ns > 0, "control period");
  const LatencyBudget& budget = clock.budget;
  Schedule schedule(budget, [&](const StageBudget& stage, std::uint64_t index) {
    return stage.duration.draw(stage.name, options.seed, index, options.items);
  });
  SensorRate camera = clock.camera;
  if (camera.period_ns == 0) camera.period_ns = options.control_period_ns;
  TimingReport report;
  report.end_to_end.name = "end_to_end";
  report.end_to_end.deadline_ns = budget.end_to_end_deadline_ns;
  std::optional<Schedule::Result> ready;             // Newest, not used yet.
  std::optional<core::TimeNs> in_use_ns;             // Capture time.
  std::map<std::uint64_t, core::TimeNs> pending_ns;  // By tick: capture time.
  const auto take_in = [&] {
    for (const Schedule::Result& done : schedule.take_results()) {
      const core::TimeNs newest_ns = ready ? ready->capture_ns : in_use_ns.value_or(-1);
      if (done.capture_ns > newest_ns) ready = done;
    }
    for (const Schedule::Effect& effect : schedule.take_effects()) {
      report.end_to_end.add(effect.time_ns - pending_ns.at(effect.tick));
      pending_ns.erase(effect.tick);
    }
  };
  std::uint64_t next_capture = 0, tick = 0;
  for (core::TimeNs now_ns = 0; now_ns <= options.duration_ns;
       now_ns += options.control_period_ns, ++tick) {
    for (; camera.time_of(next_capture, options.seed) <= now_ns; ++next_capture) {
      const core::TimeNs at_ns = camera.time_of(next_capture, options.seed);
      schedule.advance_to(at_ns - 1);  // As a trial does: the image is among the choices.
      schedule.capture(at_ns, next_capture);
    }
    schedule.advance_to(now_ns);
    take_in();
    const bool drops_late =
        budget.on_miss == OnMiss::kDrop && budget.end_to_end_deadline_ns > 0;
    if (ready && !schedule.deciding() && drops_late &&
        now_ns - ready->capture_ns > budget.end_to_end_deadline_ns) {
      report.end_to_end.add(now_ns - ready->capture_ns);
      ready.reset();
    }
    if (ready && !schedule.deciding()) {
      in_use_ns = ready->capture_ns;
      pending_ns[tick] = *in_use_ns;
      ready.reset();
      schedule.decide(now_ns, tick);
      schedule.advance_to(now_ns);
      take_in();
    } else {
      ++report.ticks_without_news;
    }
    if (in_use_ns) {
      report.age.add(now_ns - *in_use_ns);
    } else {
      ++report.ticks_without_image;
    }
  }
  schedule.report(report);
  return report;
}

}  // namespace segsim::sim
