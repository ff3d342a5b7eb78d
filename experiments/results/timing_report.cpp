#include "experiments/results/timing_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <nlohmann/json.hpp>

#include "core/formatted.h"
#include "sim/time/latency_budget.h"

namespace segsim::experiments::results {
namespace {

using Json = nlohmann::ordered_json;

Proportion misses_of(const sim::StageTiming& stage) {
  return {stage.misses, stage.response.count()};
}

std::string stage_line(const sim::StageTiming& stage) {
  const auto ms = [&](double share) {
    return sim::ms_from_ns(stage.response.percentile(share));
  };
  std::string line = core::print("%-12s %7d %9.1f %9.1f %9.1f %9.1f", stage.name.c_str(),
                                 stage.response.count(), ms(0.5), ms(0.95), ms(0.99), ms(1.0));
  if (stage.deadline_ns > 0) {
    const Interval interval = wilson_interval(misses_of(stage));
    line += core::print(" %9.1f %6.2f %% (%.2f-%.2f) %5d", sim::ms_from_ns(stage.deadline_ns),
                        100.0 * misses_of(stage).value(), 100.0 * interval.low,
                        100.0 * interval.high, stage.longest_miss_run);
  } else {
    line += core::print(" %9s %8s %13s %5s", "-", "-", "", "-");
  }
  return line + core::print(" %6d\n", stage.drops);
}

Json samples_json(const sim::DurationSamples& samples) {
  Json json = {{"n", samples.count()}};
  for (const auto& [name, share] : {std::pair{"p50_ms", 0.5}, std::pair{"p95_ms", 0.95},
                                    std::pair{"p99_ms", 0.99}, std::pair{"max_ms", 1.0}}) {
    json[name] = sim::ms_from_ns(samples.percentile(share));
  }
  return json;
}

Json stage_json(const sim::StageTiming& stage) {
  Json json = samples_json(stage.response);
  if (stage.deadline_ns > 0) {
    const Interval interval = wilson_interval(misses_of(stage));
    json["deadline_ms"] = sim::ms_from_ns(stage.deadline_ns);
    json["misses"] = stage.misses;
    json["miss_rate"] = {misses_of(stage).value(), interval.low, interval.high};
    json["longest_miss_run"] = stage.longest_miss_run;
  }
  json["drops"] = stage.drops;
  return json;
}

}  // namespace

std::vector<DeadlineCheck> check_deadlines(const sim::TimingReport& timing,
                                           double max_miss_rate, double confidence) {
  std::vector<DeadlineCheck> checks;
  const auto add = [&](const sim::StageTiming& stage) {
    if (stage.deadline_ns <= 0) return;
    DeadlineCheck check;
    check.stage = stage.name;
    check.deadline_ms = sim::ms_from_ns(stage.deadline_ns);
    check.misses = misses_of(stage);
    check.interval = wilson_interval(check.misses, confidence);
    check.longest_run = stage.longest_miss_run;
    check.holds = check.misses.trials > 0 && check.interval.high <= max_miss_rate;
    checks.push_back(check);
  };
  for (const sim::StageTiming& stage : timing.stages) add(stage);
  add(timing.end_to_end);
  return checks;
}

std::string format_timing(const sim::TimingReport& timing) {
  std::string text =
      core::print("%-12s %7s %9s %9s %9s %9s %9s %8s %13s %5s %6s\n", "stage", "n", "p50 [ms]",
                  "p95", "p99", "max", "deadline", "missed", "(95 %)", "run", "drops");
  for (const sim::StageTiming& stage : timing.stages) text += stage_line(stage);
  text += stage_line(timing.end_to_end);
  const auto age_ms = [&](double share) {
    return sim::ms_from_ns(timing.age.percentile(share));
  };
  text += core::print("age of the image in use: p50 %.1f, p95 %.1f, p99 %.1f, max %.1f ms",
                      age_ms(0.5), age_ms(0.95), age_ms(0.99), age_ms(1.0));
  text += core::print(" (%d ticks; %d without a new image, %d without any)\n",
                      timing.age.count() + timing.ticks_without_image,
                      timing.ticks_without_news, timing.ticks_without_image);
  for (const auto& [name, used] : timing.resources) {
    text += core::print("%s: %.1f %% busy (%d server%s)\n", name.c_str(),
                        100.0 * timing.utilisation(name), used.servers,
                        used.servers == 1 ? "" : "s");
  }
  if (timing.overruns > 0) {
    text += core::print("%d ticks came late: this machine does not keep up with the clock\n",
                        timing.overruns);
  }
  return text;
}

std::string format_checks(const std::vector<DeadlineCheck>& checks, double max_miss_rate,
                          double confidence) {
  std::string text;
  for (const DeadlineCheck& check : checks) {
    if (check.misses.trials == 0) {
      text +=
          core::print("FAILS  %s within %.1f ms: never ran, so there is nothing to judge\n",
                      check.stage.c_str(), check.deadline_ms);
      continue;
    }
    text += core::print(
        "%s  %s within %.1f ms: missed %d of %d, at most %.3f %% with %.0f %% "
        "confidence (limit %.3f %%), longest run %d\n",
        check.holds ? "holds" : "FAILS", check.stage.c_str(), check.deadline_ms,
        check.misses.successes, check.misses.trials, 100.0 * check.interval.high,
        100.0 * confidence, 100.0 * max_miss_rate, check.longest_run);
  }
  return text;
}

std::string timing_json(const sim::TimingReport& timing) {
  Json stages = Json::object(), load = Json::object();
  for (const sim::StageTiming& stage : timing.stages) stages[stage.name] = stage_json(stage);
  for (const auto& [name, used] : timing.resources) load[name] = timing.utilisation(name);
  return Json{{"stages", stages},
              {"end_to_end", stage_json(timing.end_to_end)},
              {"age", samples_json(timing.age)},
              {"utilisation", load},
              {"ticks_without_image", timing.ticks_without_image},
              {"ticks_without_news", timing.ticks_without_news},
              {"overruns", timing.overruns}}
      .dump(2);
}

}  // namespace segsim::experiments::results
