#include "experiments/runs/run.h"

#include <atomic>
#include <cstdio>
#include <cstring>
#include <map>
#include <mutex>
#include <set>
#include <thread>

#include <fcntl.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <unistd.h>
#include <zlib.h>
#include <opencv2/core/version.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/progress.h"
#include "core/version.h"
#include "experiments/benchmarks/machine_peaks.h"
#include "experiments/runs/prepare.h"
#include "experiments/runs/stop_signal.h"
#include "experiments/runs/trial_runner.h"
#include "renderer/simd_target.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

/// Keeps a second `segsim run` out of a work folder; released when the process ends, however.
class FolderLock {
 public:
  explicit FolderLock(const fs::path& work) {
    std::error_code error;
    fs::create_directories(work, error);
    const fs::path file = work / ".lock";
    descriptor_ = open(file.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0644);
    if (descriptor_ < 0) {
      throw core::InputError::expected(work.string(), "a folder that can be written to",
                                       std::strerror(errno));
    }
    if (flock(descriptor_, LOCK_EX | LOCK_NB) != 0) {
      close(descriptor_);
      throw core::InputError::expected(work.string(), "a work folder of its own",
                                       "another segsim run at work there");
    }
  }
  ~FolderLock() { close(descriptor_); }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_ = -1;
};

std::string host_name() {
  char name[256] = {};
  return gethostname(name, sizeof name - 1) == 0 ? name : "unknown";
}

/// What results may depend on and a version of segsim does not fix.
std::string library_versions() {
  return std::string("compiler " __VERSION__ "; OpenCV " CV_VERSION "; SQLite ") +
         sqlite3_libversion() + "; zlib " + zlibVersion() + "; SIMD " +
         renderer::simd_target();
}

std::string number_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

std::vector<SceneRow> scene_rows(const std::vector<LoadedScene>& scenes) {
  std::vector<SceneRow> rows;
  for (const LoadedScene& scene : scenes) {
    rows.push_back({scene.spec->name, scene.spec->title, scene.bundle.scene_sha256,
                    scene.episodes_sha256,
                    static_cast<std::int64_t>(scene.episodes.episodes.size())});
    if (scene.episodes.oracle) {
      rows.back().oracle_successes = scene.episodes.oracle->successes;
      rows.back().oracle_episodes = scene.episodes.oracle->episodes;
    }
  }
  return rows;
}

std::vector<ArmRow> arm_rows(const ExperimentSpec& spec, const PreparedDetectors& detectors) {
  std::vector<ArmRow> rows;
  for (const ArmSpec& arm : spec.arms) {
    ArmRow row;
    row.name = arm.name;
    const PreparedWeights weights = weights_of(arm, detectors);
    row.detector = weights.file.empty() ? "oracle" : weights.file.filename().string();
    if (!weights.file.empty()) row.weights_sha256 = core::sha256_of_file(weights.file);
    row.held_out = weights.held_out;
    if (arm.detector == ArmDetector::kAfter) row.start_leak = detectors.start_leak;
    for (const SceneSpec& scene : spec.scenes) {
      if (spec.leaks(arm, scene))
        row.tuned_on += (row.tuned_on.empty() ? "" : ", ") + scene.name;
    }
    row.score_threshold = arm.score_threshold.value_or(-1.0);
    rows.push_back(std::move(row));
  }
  return rows;
}

/// Refuses to go on with a run whose inputs are not what they were.
void check_same_inputs(const Store& store, std::int64_t run_id,
                       const std::vector<SceneRow>& scenes, const std::vector<ArmRow>& arms) {
  const auto refuse = [](const std::string& what) {
    throw core::InputError(what +
                           " changed since the run began: finished trials and new ones "
                           "would not compare. Give --new to begin another run.");
  };
  const std::vector<SceneRow> old_scenes = store.scenes(run_id);
  for (std::size_t i = 0; i < scenes.size() && i < old_scenes.size(); ++i) {
    if (scenes[i].scene_sha256 != old_scenes[i].scene_sha256)
      refuse("scene " + scenes[i].name);
    if (scenes[i].episodes_sha256 != old_scenes[i].episodes_sha256) {
      refuse("episodes of scene " + scenes[i].name);
    }
  }
  const std::vector<ArmRow> old_arms = store.arms(run_id);
  for (std::size_t i = 0; i < arms.size() && i < old_arms.size(); ++i) {
    if (arms[i].weights_sha256 != old_arms[i].weights_sha256) {
      refuse("weights of arm " + arms[i].name);
    }
  }
}

/// The run to go on with, or a new one.
std::int64_t open_run(Store& store, const ExperimentSpec& spec, const RunOptions& options,
                      const std::vector<SceneRow>& scenes, const std::vector<ArmRow>& arms,
                      int planned_trials) {
  const std::vector<RunRow> runs = store.runs();
  if (!runs.empty() && !options.new_run) {
    const RunRow& last = runs.back();
    if (last.spec_sha256 != spec.sha256) {
      throw core::InputError::expected(
          spec.file.string(),
          "the spec that run " + std::to_string(last.run_id) + " in " +
              options.folders.work.string() + " began with",
          "another text; give --new to begin another run, or another --work folder");
    }
    check_same_inputs(store, last.run_id, scenes, arms);
    if (last.code_version != core::version()) {
      std::fprintf(stderr, "segsim: note: run %lld began with segsim %s, this is %s\n",
                   static_cast<long long>(last.run_id), last.code_version.c_str(),
                   core::version());
    }
    return last.run_id;
  }
  RunRow run;
  run.name = spec.name;
  run.title = spec.title;
  run.spec_sha256 = spec.sha256;
  run.spec_text = spec.text;
  run.code_version = core::version();
  run.host = host_name() + ", " + cpu_model();
  run.libraries = library_versions();
  run.success_profile = success_in_words(spec);
  const std::string clock = clock_in_words(spec.clock);
  if (!clock.empty()) run.success_profile += "; " + clock;
  run.seed = spec.seed;
  run.planned_n = spec.planned_n;
  run.planned_trials = planned_trials;
  return store.begin_run(run, scenes, arms);
}

/// All cells of the experiment, scene by scene; the arms of an episode follow one another, so
/// that an interrupted run has pairs.
std::vector<TrialTask> all_tasks(const ExperimentSpec& spec,
                                 const std::vector<LoadedScene>& scenes) {
  std::vector<TrialTask> tasks;
  for (const LoadedScene& scene : scenes) {
    bool first = true;
    for (const sim::Episode& episode : scene.episodes.episodes) {
      for (int repetition = 0; repetition < spec.repetitions; ++repetition) {
        const auto chosen = [&](Recorded which) {
          return which == Recorded::kAll ||
                 (which == Recorded::kFirst && first && repetition == 0);
        };
        for (const ArmSpec& arm : spec.arms) {
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

std::string task_key(const std::string& arm, const std::string& episode, int repetition) {
  return arm + "\n" + episode + "\n" + std::to_string(repetition);
}

std::vector<TrialTask> unfinished(std::vector<TrialTask> tasks,
                                  const std::vector<TrialRow>& trials) {
  std::set<std::string> done;
  for (const TrialRow& trial : trials) {
    if (!trial.failed()) done.insert(task_key(trial.arm, trial.episode, trial.repetition));
  }
  std::erase_if(tasks, [&](const TrialTask& task) {
    return done.contains(task_key(task.arm->name, task.episode->id, task.repetition));
  });
  return tasks;
}

/// Success rates so far, for the progress line: "before 3/10, after 7/10".
class Tally {
 public:
  explicit Tally(const ExperimentSpec& spec) : spec_(spec) {}
  void count(const TrialRow& trial) {
    if (trial.failed()) {
      ++failed_;
      return;
    }
    if (!trial.counts()) return;
    auto& [successes, trials] = counts_[trial.arm];
    ++trials;
    successes += trial.success ? 1 : 0;
  }
  [[nodiscard]] std::string text() const {
    std::string line;
    for (const ArmSpec& arm : spec_.arms) {
      const auto found = counts_.find(arm.name);
      if (found == counts_.end()) continue;
      line += (line.empty() ? "" : ", ") + arm.name + " " +
              std::to_string(found->second.first) + "/" + std::to_string(found->second.second);
    }
    if (failed_ > 0) line += ", failed " + std::to_string(failed_);
    return line;
  }

 private:
  const ExperimentSpec& spec_;
  std::map<std::string, std::pair<int, int>> counts_;
  int failed_ = 0;
};

/// Runs the tasks on `workers` threads. @return  How many were run.
int run_tasks(const ExperimentSpec& spec, const std::vector<TrialTask>& tasks,
              const PreparedDetectors& detectors, const RunOptions& options,
              std::int64_t run_id, Store& store, Tally& tally) {
  std::atomic<std::size_t> next{0};
  std::mutex mutex;  // Guards what follows.
  std::exception_ptr failure;
  int done = 0;
  std::string first_error;
  core::Progress progress("trials", static_cast<std::int64_t>(tasks.size()));
  progress.update(0, tally.text());

  const auto work = [&] {
    TrialRunner runner(spec, detectors,
                       options.results.empty() ? options.folders.work : options.results);
    while (!StopOnSignal::requested()) {
      const std::size_t index = next.fetch_add(1);
      if (index >= tasks.size()) return;
      const TrialRow row = runner.run(tasks[index]);
      const std::lock_guard<std::mutex> lock(mutex);
      try {
        store.add_trial(run_id, row);
      } catch (...) {
        failure = std::current_exception();
        StopOnSignal::request();
        return;
      }
      if (row.failed() && first_error.empty()) first_error = row.episode + ": " + row.error;
      tally.count(row);
      progress.update(++done, tally.text());
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
  return done;
}

void write_text(const fs::path& file, const std::string& text) {
  core::write_file_atomically(file, [&](std::ostream& out) { out << text; });
}

}  // namespace

std::string success_in_words(const ExperimentSpec& spec) {
  const std::string text = spec.success.profile + ": " + sim::in_words(spec.success.rule());
  return text + ", within " + number_text(spec.time_limit_s) + " s";
}

void write_tables(const fs::path& work, const ResultTable& table,
                  const std::vector<TrialRow>& trials) {
  for (const auto& [ending, format] : table_files()) {
    write_text(work / ("table" + ending), format_table(table, format));
  }
  core::write_file_atomically(work / "trials.csv",
                              [&](std::ostream& out) { write_trials_csv(out, trials); });
}

RunReport run_experiment(const ExperimentSpec& spec, const RunOptions& options) {
  const fs::path& work = options.folders.work;
  const FolderLock lock(work);

  // What the trials need.
  std::vector<fs::path> bundles;
  for (const SceneSpec& scene : spec.scenes)
    bundles.push_back(prepare_scene(spec, scene, work));
  std::vector<LoadedScene> scenes;
  std::vector<Starts> starts;
  std::set<std::string> episode_ids;
  for (std::size_t i = 0; i < spec.scenes.size(); ++i) {
    std::fprintf(stderr, "segsim: loading %s\n", spec.scenes[i].title.c_str());
    scenes.push_back(load_scene(spec, spec.scenes[i], bundles[i], work));
    starts.push_back(starts_of(scenes.back()));
    const EpisodeSet& set = scenes.back().episodes;
    for (const sim::Episode& episode : set.episodes) {
      if (episode_ids.insert(episode.id).second) continue;
      throw core::InputError::expected("episodes of scene " + spec.scenes[i].name,
                                       "names that no other episode of the spec has",
                                       "\"" + episode.id + "\" again");
    }
    if (spec.scenes[i].episode_file.empty() &&
        static_cast<int>(set.episodes.size()) < spec.scenes[i].episodes) {
      std::fprintf(stderr, "segsim: note: %s has room for %zu of %d episodes (see %s)\n",
                   spec.scenes[i].title.c_str(), set.episodes.size(), spec.scenes[i].episodes,
                   (work / "episodes" / (spec.scenes[i].name + ".jsonl")).c_str());
    }
  }
  const PreparedDetectors detectors = prepare_detectors(spec, bundles, starts, work);

  // The run, and which of its trials are missing.
  const fs::path& results = options.results.empty() ? work : options.results;
  Store store(results / "results.sqlite");
  const std::vector<TrialTask> planned = all_tasks(spec, scenes);
  RunReport report;
  report.run_id = open_run(store, spec, options, scene_rows(scenes), arm_rows(spec, detectors),
                           static_cast<int>(planned.size()));
  std::vector<TrialTask> tasks = unfinished(planned, store.trials(report.run_id));
  const std::size_t missing = tasks.size();
  if (options.max_trials > 0 && tasks.size() > static_cast<std::size_t>(options.max_trials)) {
    tasks.resize(static_cast<std::size_t>(options.max_trials));
  }

  if (!options.prepare_only && !tasks.empty()) {
    const StopOnSignal signals;
    Tally tally(spec);
    for (const TrialRow& trial : store.trials(report.run_id)) {
      if (!trial.failed()) tally.count(trial);
    }
    report.trials_run =
        run_tasks(spec, tasks, detectors, options, report.run_id, store, tally);
    report.interrupted = StopOnSignal::requested();
  }
  report.trials_left = static_cast<int>(missing) - report.trials_run;

  // The answer.
  const std::vector<TrialRow> trials = store.trials(report.run_id);
  const std::vector<RunRow> runs = store.runs();
  if (report.trials_left == 0 && runs.back().ended.empty()) store.end_run(report.run_id);
  report.table = summarise(store.runs().back(), store.scenes(report.run_id),
                           store.arms(report.run_id), trials);
  write_tables(results, report.table, trials);
  return report;
}

}  // namespace segsim::experiments
