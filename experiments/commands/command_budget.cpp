// `segsim budget check`, `sweep`, `measure` and `trace`.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/process/measurement_record.h"
#include "core/version.h"
#include "experiments/commands/commands.h"
#include "experiments/commands/run_flags.h"
#include "experiments/records/replay_log.h"
#include "experiments/records/store.h"
#include "experiments/results/timing_report.h"
#include "experiments/runs/budget_measure.h"
#include "experiments/runs/budget_sweep.h"
#include "experiments/specs/budget_file.h"
#include "experiments/support/shipped_file.h"
#include "perception/data/image_file.h"
#include "sim/time/budget_play.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct CheckFlags {
  fs::path budget, run;
  std::string arm, json;
  double max_miss_rate = -1.0, confidence = 0.95;
  double seconds = 600.0, control_period_s = 0.1, camera_period_s = 0.0;
  std::uint64_t seed = 1;
  int items = 2;
};

/// Deadlines of the budget in place of those with which a trial ran.
void apply_deadlines(const sim::LatencyBudget& budget, sim::TimingReport& timing) {
  const auto judge_again = [](sim::StageTiming& stage, core::TimeNs deadline_ns) {
    sim::StageTiming judged;
    judged.name = stage.name;
    judged.deadline_ns = deadline_ns;
    judged.drops = stage.drops;
    for (const core::TimeNs response_ns : stage.response.values_ns()) judged.add(response_ns);
    stage = std::move(judged);
  };
  for (sim::StageTiming& stage : timing.stages) {
    const sim::StageBudget* known = budget.find(stage.name);
    judge_again(stage, known != nullptr ? known->deadline_ns : 0);
  }
  judge_again(timing.end_to_end, budget.end_to_end_deadline_ns);
}

/// Adds what the budget sets a deadline for and no trial played: it must not go unsaid.
void add_what_never_ran(const sim::LatencyBudget& budget, sim::TimingReport& timing) {
  for (const sim::StageBudget& stage : budget.stages) {
    const bool judged = stage.charge == sim::Charge::kRobot && stage.deadline_ns > 0;
    if (!judged || timing.find(stage.name) != nullptr) continue;
    sim::StageTiming missing;
    missing.name = stage.name;
    missing.deadline_ns = stage.deadline_ns;
    timing.stages.push_back(std::move(missing));
  }
}

/// Timings of all trials of a run (or of one of its arms), against the budget's deadlines.
sim::TimingReport timing_of_run(const fs::path& work, const std::string& arm,
                                const sim::LatencyBudget& budget) {
  const fs::path folder = work / "replays";
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry : fs::recursive_directory_iterator(folder, error)) {
    if (entry.path().extension() == ".jsonl") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  sim::TimingReport timing;
  int used = 0;
  for (const fs::path& file : files) {
    records::ReplayLog log = records::read_replay_log(file);
    if (!arm.empty() && log.arm != arm) continue;
    if (log.clock_mode == sim::to_string(sim::ClockMode::kLockstep)) {
      throw core::InputError::expected(
          file.string(), "a trial in which time passed (clock: virtual, measured, realtime)",
          "lockstep, where everything takes no time and every deadline holds");
    }
    // One by one: a run of misses ends with its trial.
    apply_deadlines(budget, log.timing);
    timing.append(log.timing);
    ++used;
  }
  if (used == 0) {
    throw core::InputError::expected(folder.string(), "replay logs of the run", "none");
  }
  std::printf("%d trials of %s\n", used, work.c_str());
  return timing;
}

sim::TimingReport play(const CheckFlags& flags, const sim::LatencyBudget& budget) {
  sim::TrialClock clock;
  clock.mode = sim::ClockMode::kVirtual;
  clock.budget = budget;
  clock.camera.period_ns = std::llround(flags.camera_period_s * 1e9);
  sim::BudgetPlayOptions options;
  options.control_period_ns = std::llround(flags.control_period_s * 1e9);
  options.duration_ns = std::llround(flags.seconds * 1e9);
  options.seed = flags.seed;
  options.items = flags.items;
  std::printf("%g s of simulated time, seed %llu\n", flags.seconds,
              static_cast<unsigned long long>(flags.seed));
  return sim::play_budget(clock, options);
}

void check(const CheckFlags& flags) {
  const specs::BudgetFile file = specs::read_budget_file(flags.budget);
  const double limit =
      flags.max_miss_rate >= 0.0 ? flags.max_miss_rate : file.max_miss_rate.value_or(0.01);
  sim::TimingReport timing;
  if (flags.run.empty()) {
    timing = play(flags, file.budget);
  } else {
    timing = timing_of_run(flags.run, flags.arm, file.budget);
    add_what_never_ran(file.budget, timing);
  }
  std::fputs(results::format_timing(timing).c_str(), stdout);
  if (!flags.json.empty()) {
    core::write_file_atomically(
        flags.json, [&](std::ostream& out) { out << results::timing_json(timing) << '\n'; });
  }
  const std::vector<results::DeadlineCheck> checks =
      results::check_deadlines(timing, limit, flags.confidence);
  if (checks.empty()) {
    throw core::InputError::expected(flags.budget.string(),
                                     "a deadline_ms of a stage, or end_to_end", "none");
  }
  std::fputs(results::format_checks(checks, limit, flags.confidence).c_str(), stdout);
  const auto failed = std::count_if(checks.begin(), checks.end(),
                                    [](const results::DeadlineCheck& c) { return !c.holds; });
  if (failed > 0) {
    throw core::CheckFailed(std::to_string(failed) + " of " + std::to_string(checks.size()) +
                            " deadlines do not hold");
  }
}

struct SweepFlags {
  std::string spec;
  runs::SweepOptions sweep;
  runs::RunOptions run;
  fs::path output;
};

void sweep(SweepFlags& flags) {
  std::vector<double>& delays = flags.sweep.add_ms;
  std::sort(delays.begin(), delays.end());
  delays.erase(std::unique(delays.begin(), delays.end()), delays.end());
  if (delays.size() < 2) {
    throw core::InputError::expected("--add-ms", "two or more delays",
                                     std::to_string(delays.size()));
  }
  const specs::ExperimentSpec spec = specs::load_spec(flags.spec, flags.run.folders);
  const specs::ExperimentSpec swept = runs::sweep_spec(spec, flags.sweep);
  const std::string arm = flags.sweep.arm.empty() ? spec.arms.front().name : flags.sweep.arm;
  if (flags.output.empty()) {
    flags.output = flags.run.folders.work / ("sweep-" + flags.sweep.stage + "-" + arm);
  }
  flags.run.results = flags.output;
  const runs::RunReport report = runs::run_experiment(swept, flags.run);
  const records::Store store(flags.output / "results.sqlite");
  const runs::SweepResult result =
      runs::summarise_sweep(flags.sweep, arm, store.trials(report.run_id));
  std::fputs(runs::format_sweep(result, flags.sweep).c_str(), stdout);
  runs::write_sweep_csv(flags.output / "sweep.csv", result);
  const std::string footer =
      spec.title + ", arm " + arm + ", budget " +
      specs::trial_clock(spec.clock, swept.arms.front().clock).budget.id + ", segsim " +
      core::version();
  perception::write_image(flags.output / "sweep.png",
                          runs::draw_sweep(result, flags.sweep, footer));
  std::printf("%s\n", (flags.output / "sweep.png").c_str());
  if (report.trials_left > 0) {
    std::printf("%d trials left; run the same command again to go on.\n", report.trials_left);
  }
}

struct MeasureFlags {
  std::string spec, arm;
  RunFlags run;
  runs::MeasuredBudget about;
  fs::path output;
};

void measure(MeasureFlags& flags) {
  const fs::path file = support::find_shipped(flags.spec);
  runs::RunOptions& run = flags.run.options;
  const specs::ExperimentSpec spec = runs::measured_spec(
      specs::parse_spec(with_flags(core::read_file(file), flags.run), file, run.folders),
      flags.arm);
  run.results = run.folders.work / ("budget-" + spec.arms.front().name);
  run.new_run = true;
  run.workers = 1;  // Trials beside each other would wait for each other.
  const runs::RunReport report = runs::run_experiment(spec, run);
  const records::Store store(run.results / "results.sqlite");
  runs::StageDurations durations;
  for (const records::TrialRow& trial : store.trials(report.run_id)) {
    const fs::path log = records::replay_log_of(run.results, trial);
    runs::add_durations(records::read_replay_log(log).trace, durations);
  }
  flags.about.origin =
      core::processor_name() + ", segsim " + core::version() + ": " + core::command_line();
  flags.about.processors = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  flags.about.detects_on_gpu = spec.backend == renderer::Backend::kCuda;
  const std::string text = runs::budget_text(flags.about, durations);
  core::write_file_atomically(flags.output, [&](std::ostream& out) { out << text; });
  std::fputs(text.c_str(), stdout);
}

struct TraceFlags {
  std::vector<fs::path> logs;
  fs::path output;
};

/// Durations of recorded trials as a file for `trace:` of a budget. Of one trial the indices
/// stay, so that playing it gives that trial again; several are put in a row.
void write_trace(const TraceFlags& flags) {
  sim::LatencyTrace trace;
  std::map<std::string, std::uint64_t> next;
  for (const fs::path& file : flags.logs) {
    const records::ReplayLog log = records::read_replay_log(file);
    for (const auto& [stage, entries] : log.trace.stages()) {
      for (const auto& [index, duration_ns] : entries) {
        trace.add(stage, flags.logs.size() == 1 ? index : next[stage]++, duration_ns);
      }
    }
  }
  if (trace.empty()) {
    throw core::InputError::expected(flags.logs.front().string(), "durations of stages",
                                     "none: the trial ran in lockstep");
  }
  specs::write_trace_csv(flags.output, trace);
  for (const auto& [stage, entries] : trace.stages()) {
    std::printf("%s: %zu durations\n", stage.c_str(), entries.size());
  }
}

void add_trace(CLI::App& budget) {
  auto flags = std::make_shared<TraceFlags>();
  CLI::App* command = budget.add_subcommand(
      "trace", "Durations that trials recorded, as a file for `trace:` of a budget");
  command->add_option("logs", flags->logs, "Replay logs (<work>/replays/...jsonl)")
      ->required();
  command->add_option("-o,--output", flags->output, "CSV file")->required();
  command->callback([flags] { write_trace(*flags); });
}

void add_check(CLI::App& budget) {
  auto flags = std::make_shared<CheckFlags>();
  CLI::App* command = budget.add_subcommand(
      "check",
      "Exit code 1 if a deadline is missed too often (for CI). Without --run the budget is "
      "played on its own, without a scene.");
  command->add_option("budget", flags->budget, "Latency budget (YAML)")->required();
  command->add_option("--run", flags->run,
                      "Work folder of `segsim run`: judge what its trials took");
  command->add_option("--arm", flags->arm, "With --run: one arm only");
  command
      ->add_option("--max-miss-rate", flags->max_miss_rate,
                   "Largest share of misses (default: max_miss_rate of the file, or 0.01)")
      ->check(CLI::Range(0.0, 1.0));
  command->add_option("--confidence", flags->confidence, "Of the interval of the miss rate")
      ->check(CLI::Range(0.5, 0.9999))
      ->capture_default_str();
  command->add_option("--seconds", flags->seconds, "Simulated time to play [s]")
      ->check(CLI::Range(1.0, 1e6))
      ->capture_default_str();
  command->add_option("--control-period", flags->control_period_s, "Of the robot [s]")
      ->check(CLI::Range(0.001, 10.0))
      ->capture_default_str();
  command
      ->add_option("--camera-period", flags->camera_period_s,
                   "Of the camera [s] (0: the control period)")
      ->check(CLI::Range(0.0, 60.0));
  command->add_option("--items", flags->items, "Detections of each image")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  command->add_option("--seed", flags->seed, "Of the durations")->capture_default_str();
  command->add_option("--json", flags->json, "Also write the figures there");
  command->callback([flags] { check(*flags); });
}

void add_sweep(CLI::App& budget) {
  auto flags = std::make_shared<SweepFlags>();
  CLI::App* command = budget.add_subcommand(
      "sweep", "Success rate against added delay: trials of a spec, a table and a plot");
  command->add_option("spec", flags->spec, "Experiment (YAML) with clock: {mode: virtual}")
      ->required();
  command->add_option("--stage", flags->sweep.stage, "Stage that takes longer")
      ->capture_default_str();
  command
      ->add_option("--add-ms", flags->sweep.add_ms, "Delays, for example 0,100,200,400 [ms]")
      ->delimiter(',')
      ->required()
      ->check(CLI::Range(0.0, 60000.0));
  command->add_option("--arm", flags->sweep.arm, "Arm of the spec (default: the first)");
  command->add_option("--delta", flags->sweep.delta, "Loss of success that is accepted")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--data", flags->run.folders.data, "Folder that ${data} stands for");
  command->add_option("--work", flags->run.folders.work,
                      "Work folder of the spec (default: out/<name of the spec>)");
  command->add_option("-o,--output", flags->output,
                      "Folder for results (default: <work>/sweep-<stage>-<arm>)");
  command->add_option("--workers", flags->run.workers, "Trials at the same time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command->add_option("--max-trials", flags->run.max_trials, "Stop after so many (0 = all)")
      ->check(CLI::NonNegativeNumber);
  command->add_flag("--new", flags->run.new_run, "Begin again");
  command->callback([flags] { sweep(*flags); });
}

void add_measure(CLI::App& budget) {
  auto flags = std::make_shared<MeasureFlags>();
  flags->run.options.max_trials = 4;
  flags->about.id = "measured";
  CLI::App* command = budget.add_subcommand(
      "measure",
      "Run some trials one by one, and write what this machine's stages took as a "
      "budget");
  command->add_option("spec", flags->spec, "Experiment (YAML)")->required();
  command->add_option("--arm", flags->arm, "Arm of the spec (default: the first)");
  command->add_option("--id", flags->about.id, "Name of the budget")->capture_default_str();
  command->add_option("--trials", flags->run.options.max_trials, "How many trials")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_option("-o,--output", flags->output, "YAML file")->required();
  command->add_option("--data", flags->run.options.folders.data,
                      "Folder that ${data} stands for");
  command->add_option("--work", flags->run.options.folders.work,
                      "Work folder of the spec (default: out/<name of the spec>)");
  command->add_option("--backend", flags->run.backend, "cpu | cuda (default: the spec's)")
      ->check(CLI::IsMember({"cpu", "cuda"}));
  command->callback([flags] { measure(*flags); });
}

}  // namespace

void add_budget_command(CLI::App& app) {
  CLI::App* budget = light::add_listed(app, light::kCommands, "budget");
  budget->require_subcommand(1);
  add_check(*budget);
  add_sweep(*budget);
  add_measure(*budget);
  add_trace(*budget);
}

}  // namespace segsim::experiments::commands
