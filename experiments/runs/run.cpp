#include "experiments/runs/run.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <thread>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "core/process/kernel_choice.h"
#include "core/progress.h"
#include "core/version.h"
#include "experiments/records/results_digest.h"
#include "experiments/reproducibility/stage_digests.h"
#include "experiments/runs/internal/run_checks.h"
#include "experiments/runs/internal/task_queue.h"
#include "experiments/runs/prepare.h"
#include "experiments/runs/run_provenance.h"
#include "experiments/support/folder_lock.h"
#include "experiments/support/listed.h"
#include "experiments/support/step_record.h"
#include "experiments/support/stop_signal.h"
#include "experiments/trials/trial_runner.h"
#include "reconstruction/training/geometry_training.h"

namespace segsim::experiments::runs {
namespace {

namespace fs = std::filesystem;

std::string number_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

/// The run to go on with, or a new one.
std::int64_t open_run(records::Store& store, const specs::ExperimentSpec& spec,
                      const RunOptions& options, const std::vector<records::SceneRow>& scenes,
                      const std::vector<records::ArmRow>& arms, int planned_trials,
                      const std::map<std::string, std::string>& more_provenance) {
  const std::vector<records::RunRow> runs = store.runs();
  if (!runs.empty() && !options.new_run) {
    const records::RunRow& last = runs.back();
    if (last.spec_sha256 != spec.sha256) {
      throw core::InputError::expected(
          spec.file.string(),
          "the spec that run " + std::to_string(last.run_id) + " in " +
              options.folders.work.string() + " began with",
          "another text; give --new to begin another run, or another --work folder");
    }
    check_same_inputs(store, last.run_id, scenes, arms);
    const std::string kernels = core::to_string(core::kernel_choice());
    const auto began = last.provenance.find("kernels");
    if (began != last.provenance.end() && began->second != kernels) {
      throw core::InputError::expected(
          "run " + std::to_string(last.run_id) + " in " + options.folders.work.string(),
          began->second + " kernels, with which it began (--fast says which)", kernels);
    }
    check_same_programs(last.provenance, program_provenance(spec));
    if (last.code_version != core::version()) {
      if (options.shard) {
        throw core::InputError::expected("shard " + options.shard->text(),
                                         "segsim " + last.code_version + ", it began so",
                                         core::version());
      }
      std::fprintf(stderr, "segsim: note: run %lld began with segsim %s, this is %s\n",
                   static_cast<long long>(last.run_id), last.code_version.c_str(),
                   core::version());
    }
    return last.run_id;
  }
  records::RunRow run;
  run.name = spec.name;
  run.title = spec.title;
  run.spec_sha256 = spec.sha256;
  run.spec_text = spec.text;
  run.code_version = core::version();
  run.host = host_and_processor();
  run.libraries = library_versions();
  run.success_profile = success_in_words(spec);
  const std::string clock = specs::clock_in_words(spec.clock);
  if (!clock.empty()) run.success_profile += "; " + clock;
  if (spec.motion) {
    run.success_profile += "; moved by Gazebo, world " + spec.motion->world;
  }
  run.seed = spec.seed;
  run.planned_n = spec.planned_n;
  run.planned_trials = planned_trials;
  run.provenance = run_provenance(spec, options.shard);
  run.provenance.insert(more_provenance.begin(), more_provenance.end());
  return store.begin_run(run, scenes, arms);
}

/// Of an arm in its reconstruction.
bool is_first_training(const specs::ExperimentSpec& spec, const specs::ArmSpec& arm) {
  return !arm.finetune_seed || *arm.finetune_seed == spec.detectors.finetune->seed;
}

/// All cells of the experiment, scene by scene; the arms of an episode follow one another, so
/// that an interrupted run has pairs.
std::vector<trials::TrialTask> all_tasks(const specs::ExperimentSpec& spec,
                                         const std::vector<trials::LoadedScene>& scenes) {
  std::vector<trials::TrialTask> tasks;
  for (const trials::LoadedScene& scene : scenes) {
    bool first = true;
    for (const sim::Episode& episode : scene.episodes.episodes) {
      for (int repetition = 0; repetition < spec.repetitions.trials; ++repetition) {
        for (const specs::ArmSpec& arm : spec.arms) {
          if (arm.reconstruction != scene.spec->reconstruction) continue;
          const bool is_first = first && repetition == 0 && is_first_training(spec, arm);
          const auto chosen = [&](specs::Recorded which) {
            return which == specs::Recorded::kAll ||
                   (which == specs::Recorded::kFirst && is_first);
          };
          tasks.push_back({&scene, &episode, &arm, repetition, chosen(spec.videos),
                           chosen(spec.frames.of)});
          tasks.back().replay_log = chosen(spec.replays.of);
        }
      }
      first = false;
    }
  }
  return tasks;
}

/// Those of one part, in whole units.
std::vector<trials::TrialTask> tasks_of(const Shard& shard,
                                        const std::vector<trials::TrialTask>& all) {
  std::vector<trials::TrialTask> tasks;
  std::size_t unit = 0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (k > 0 && !internal::same_unit(all[k - 1], all[k])) ++unit;
    if (shard.has(unit)) tasks.push_back(all[k]);
  }
  return tasks;
}

std::string task_key(const std::string& arm, const std::string& episode, int repetition) {
  return arm + "\n" + episode + "\n" + std::to_string(repetition);
}

std::vector<trials::TrialTask> unfinished(std::vector<trials::TrialTask> tasks,
                                          const std::vector<records::TrialRow>& trials) {
  std::set<std::string> done;
  for (const records::TrialRow& trial : trials) {
    if (!trial.failed()) done.insert(task_key(trial.arm, trial.episode, trial.repetition));
  }
  std::erase_if(tasks, [&](const trials::TrialTask& task) {
    return done.contains(task_key(task.arm->name, task.episode->id, task.repetition));
  });
  return tasks;
}

/// Success rates so far, all trainings of an arm together, for the progress line: "before
/// 3/10, after 7/10".
class Tally {
 public:
  explicit Tally(const specs::ExperimentSpec& spec) {
    for (const specs::ArmSpec& arm : spec.arms) {
      family_[arm.name] = arm.family;
      const bool known = std::find(order_.begin(), order_.end(), arm.family) != order_.end();
      if (!known) order_.push_back(arm.family);
    }
  }
  void count(const records::TrialRow& trial) {
    if (trial.failed()) {
      ++failed_;
      return;
    }
    if (!trial.counts()) return;
    auto& [successes, trials] = counts_[family_[trial.arm]];
    ++trials;
    successes += trial.success ? 1 : 0;
  }
  [[nodiscard]] std::string text() const {
    std::string line;
    for (const std::string& arm : order_) {
      const auto found = counts_.find(arm);
      if (found == counts_.end()) continue;
      line += (line.empty() ? "" : ", ") + arm + " " + std::to_string(found->second.first) +
              "/" + std::to_string(found->second.second);
    }
    if (failed_ > 0) line += ", failed " + std::to_string(failed_);
    return line;
  }

 private:
  std::vector<std::string> order_;             ///< Arms of the spec.
  std::map<std::string, std::string> family_;  ///< Which of them an arm is a training of.
  std::map<std::string, std::pair<int, int>> counts_;
  int failed_ = 0;
};

/// If nothing can be written, the next trial will fail like the last one: the disk is full, or
/// gone, and the run ends instead.
/// @throws core::InputError
void check_disk(const fs::path& results) {
  constexpr std::size_t kProbe_bytes = 1 << 20;
  const fs::path probe = results / ".probe";
  core::write_file_atomically(
      probe, [&](std::ostream& out) { out << std::string(kProbe_bytes, '\0'); });
  fs::remove(probe);
}

/// Memory of one worker for shared images: all workers together take a quarter of the
/// machine's at most.
std::size_t views_bytes(int workers) {
  const auto all = static_cast<std::size_t>(sysconf(_SC_PHYS_PAGES)) *
                   static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  return std::min(trials::SharedViews::kCapacity_bytes,
                  all / 4 / static_cast<std::size_t>(workers));
}

/// Runs the tasks on `workers` threads. Fills in trials_run and store_s.
void run_tasks(const specs::ExperimentSpec& spec, const std::vector<trials::TrialTask>& tasks,
               const trials::PreparedDetectors& detectors, const RunOptions& options,
               const fs::path& results, records::Store& store, Tally& tally,
               RunReport& report) {
  using Clock = std::chrono::steady_clock;
  internal::TaskQueue queue(tasks, options.workers);
  std::mutex mutex;  // Guards what follows.
  std::exception_ptr failure;
  std::string first_error;
  core::Progress progress("trials", static_cast<std::int64_t>(tasks.size()));
  progress.update(0, tally.text());

  const auto store_row = [&](const records::TrialRow& row) {
    if (row.failed()) check_disk(results);
    const Clock::time_point start = Clock::now();
    store.add_trial(report.run_id, row);
    report.store_s += std::chrono::duration<double>(Clock::now() - start).count();
    if (row.failed() && first_error.empty()) first_error = row.episode + ": " + row.error;
    tally.count(row);
    progress.update(++report.trials_run, tally.text());
  };
  const auto work = [&] {
    trials::TrialRunner runner(spec, detectors, results, views_bytes(options.workers));
    for (auto unit = queue.next(); !unit.empty(); unit = queue.next()) {
      for (const trials::TrialTask& task : unit) {
        if (support::StopOnSignal::requested()) return;
        const records::TrialRow row = runner.run(task);
        const std::lock_guard<std::mutex> lock(mutex);
        try {
          store_row(row);
        } catch (...) {
          if (!failure) failure = std::current_exception();
          support::StopOnSignal::request();
          return;
        }
      }
    }
  };
  std::vector<std::thread> threads;
  for (int k = 1; k < options.workers; ++k) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();
  progress.finish();
  if (failure) std::rethrow_exception(failure);
  if (!first_error.empty()) {
    std::fprintf(stderr, "segsim: a trial failed: %s\n", first_error.c_str());
  }
}

}  // namespace

std::string success_in_words(const specs::ExperimentSpec& spec) {
  const std::string text = spec.success.profile + ": " + sim::in_words(spec.success.rule());
  return text + ", within " + number_text(spec.time_limit_s) + " s";
}

void write_tables(const fs::path& work, const results::ResultTable& table,
                  const std::vector<records::TrialRow>& trials) {
  results::write_table_files(work, "table", [&](support::TableFormat format) {
    return results::format_table(table, format);
  });
  core::write_file_atomically(
      work / "trials.csv", [&](std::ostream& out) { records::write_trials_csv(out, trials); });
}

namespace {

support::StepRecord preparation_of(const specs::ExperimentSpec& spec, const fs::path& work) {
  return {work / "prepared.step", "spec " + spec.sha256 + ", segsim " + core::version()};
}

/// The inputs of one worker among others: whoever is first makes them while the others wait,
/// then all work side by side. `lock` holds until the worker has ended.
Inputs load_shared_inputs(const specs::ExperimentSpec& spec, const fs::path& work, int workers,
                          support::StageTimes& times,
                          std::optional<support::FolderLock>& lock) {
  const support::StepRecord preparation = preparation_of(spec, work);
  const auto check_current = [&] {
    if (preparation.is_current()) return;
    throw core::InputError::expected(
        (work / "prepared.step").string(),
        "inputs for this spec and program (make them with segsim run SPEC --prepare-only)",
        "those for others");
  };
  if (!fs::exists(work / "prepared.step")) {
    lock.emplace(work, support::FolderLock::Kind::kExclusive,
                 support::FolderLock::IfTaken::kWait);
    if (!fs::exists(work / "prepared.step")) {
      Inputs inputs = prepare_inputs(spec, work, workers, times);
      preparation.mark_done();
      lock->share();
      return inputs;
    }
    lock.reset();
  }
  check_current();
  lock.emplace(work, support::FolderLock::Kind::kShared, support::FolderLock::IfTaken::kWait);
  check_current();
  return prepare_inputs(spec, work, workers, times);
}

}  // namespace

namespace {

std::vector<fs::path> bundles_of(const Inputs& inputs) {
  std::vector<fs::path> folders;
  for (const trials::LoadedScene& scene : inputs.scenes)
    folders.push_back(scene.bundle.folder);
  folders.insert(folders.end(), inputs.learnt_bundles.begin(), inputs.learnt_bundles.end());
  return folders;
}

reproducibility::DigestRecord digest_record(
    const specs::ExperimentSpec& spec,
    const std::vector<reproducibility::StageDigest>& stages) {
  const reproducibility::MachineRecord machine = reproducibility::describe_machine();
  return {spec.name,
          spec.sha256,
          core::version(),
          machine,
          {reproducibility::processor_in_words(machine)},
          stages};
}

}  // namespace

RunReport run_experiment(const specs::ExperimentSpec& spec, const RunOptions& options) {
  using IfTaken = support::FolderLock::IfTaken;
  using Kind = support::FolderLock::Kind;
  const fs::path& work = options.folders.work;
  const support::StageTimes::Clock::time_point start = support::StageTimes::Clock::now();
  // Before hours of work.
  internal::check_motion(spec, options.workers);
  internal::check_policy_models(spec, options.workers);
  (void)reconstruction::trains_on_gpu({.backend = spec.backend});
  support::StageTimes times;
  std::optional<support::StopOnSignal> signals(std::in_place);
  std::optional<support::FolderLock> lock, shard_lock;
  fs::path results = options.results.empty() ? work : options.results;
  Inputs inputs;
  if (options.shard) {
    SEGSIM_CHECK(!options.new_run && !options.prepare_only, "those are for whole runs");
    inputs = load_shared_inputs(spec, work, options.workers, times, lock);
    results /= fs::path("shards") / options.shard->folder_name();
    // Another process on the same part is one that its engine gave up too early.
    shard_lock.emplace(results, Kind::kExclusive, IfTaken::kWait);
  } else {
    lock.emplace(work, Kind::kExclusive, IfTaken::kRefuse);
    inputs = prepare_inputs(spec, work, options.workers, times);
    preparation_of(spec, work).mark_done();
  }

  internal::check_goals_known(spec, inputs);

  // The run, and which of its trials are missing.
  records::Store store(results / "results.sqlite");
  const std::vector<trials::TrialTask> all = all_tasks(spec, inputs.scenes);
  RunReport report;
  report.run_id =
      open_run(store, spec, options, scene_rows(inputs.scenes),
               arm_rows(spec, inputs.detectors, inputs.scenes), static_cast<int>(all.size()),
               generalisation_provenance(spec, inputs.detectors));
  if (!inputs.new_classes.empty()) {
    store.set_provenance(report.run_id, "new_classes", support::listed(inputs.new_classes));
    const std::string untaught = internal::untaught_goals(spec, inputs);
    if (!untaught.empty()) store.set_provenance(report.run_id, "untaught_goals", untaught);
  }
  for (const auto& [scene, words] : inputs.masks) {
    store.set_provenance(report.run_id, "masks/" + scene, words);
  }
  std::vector<records::TrialRow> trials = store.trials(report.run_id);
  std::vector<trials::TrialTask> tasks =
      unfinished(options.shard ? tasks_of(*options.shard, all) : all, trials);
  const std::size_t missing = tasks.size();
  if (options.max_trials > 0 && tasks.size() > static_cast<std::size_t>(options.max_trials)) {
    tasks.resize(static_cast<std::size_t>(options.max_trials));
  }

  if (!options.prepare_only && !tasks.empty()) {
    support::StageTimes::Timer timer(times, "trials");
    timer.working();
    Tally tally(spec);
    for (const records::TrialRow& trial : trials) {
      if (!trial.failed()) tally.count(trial);
    }
    run_tasks(spec, tasks, inputs.detectors, options, results, store, tally, report);
    report.interrupted = support::StopOnSignal::requested();
    trials = store.trials(report.run_id);
  }
  report.trials_left = static_cast<int>(missing) - report.trials_run;
  for (const records::TrialRow& trial : trials) report.trials_failed += trial.failed() ? 1 : 0;

  signals.reset();  // What follows is short, and not to be left half done.

  // The answer.
  const records::RunRow run = store.runs().back();
  if (report.trials_left == 0 && run.ended.empty()) store.end_run(report.run_id);
  report.results = results;
  report.results_sha256 = records::results_sha256(trials);
  if (!options.shard) {  // A part has no table of its own.
    support::StageTimes::Timer timer(times, "tables");
    timer.working();
    report.table = results::summarise(store.runs().back(), store.scenes(report.run_id),
                                      store.arms(report.run_id), trials);
    write_tables(results, report.table, trials);
    const bool complete = report.trials_left == 0 && report.trials_failed == 0;
    report.digests = reproducibility::digest_stages(work, bundles_of(inputs),
                                                    complete ? report.results_sha256 : "");
    reproducibility::write_digests(results / "digests.json",
                                   digest_record(spec, report.digests));
  }
  report.times = times.all();
  report.wall_s =
      std::chrono::duration<double>(support::StageTimes::Clock::now() - start).count();
  for (const auto& [name, value] : support::stage_time_rows(report.times, run.provenance)) {
    store.set_provenance(report.run_id, name, value);
  }
  return report;
}

}  // namespace segsim::experiments::runs
