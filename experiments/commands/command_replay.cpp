// `segsim replay`: runs recorded trials again and compares them tick by tick.
#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <unistd.h>
#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/version.h"
#include "experiments/commands/commands.h"
#include "experiments/runs/prepare.h"
#include "experiments/runs/trial_runner.h"
#include "experiments/timing/replay_log.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

struct ReplayFlags {
  std::vector<fs::path> paths;
  SpecFolders folders;
  bool verify = false, from_log = false;
};

/// The log files of the paths, folders searched.
std::vector<fs::path> log_files(const std::vector<fs::path>& paths) {
  std::vector<fs::path> files;
  for (const fs::path& path : paths) {
    if (!fs::exists(path)) {
      throw core::InputError::expected(path.string(), "a replay log or a folder", "none");
    }
    if (!fs::is_directory(path)) {
      files.push_back(path);
      continue;
    }
    for (const auto& entry : fs::recursive_directory_iterator(path)) {
      if (entry.path().extension() == ".jsonl" &&
          entry.path().string().find("replays") != std::string::npos) {
        files.push_back(entry.path());
      }
    }
  }
  std::sort(files.begin(), files.end());
  if (files.empty()) throw core::InputError::expected("segsim replay", "replay logs", "none");
  return files;
}

/// The work folder that the log lies in: what stands before replays/.
fs::path work_of(const fs::path& file) {
  for (fs::path folder = fs::absolute(file).parent_path(); folder.has_relative_path();
       folder = folder.parent_path()) {
    if (folder.filename() == "replays") return folder.parent_path();
  }
  throw core::InputError::expected(file.string(), "a log below <work>/replays, or --work",
                                   "another place");
}

/// A folder for what the replays write; gone in the end.
class Scratch {
 public:
  Scratch()
      : path_(fs::temp_directory_path() / ("segsim-replay-" + std::to_string(getpid()))) {
    fs::create_directories(path_);
  }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

/// The experiment that logs belong to: one spec, its scenes as they are needed.
class Stage {
 public:
  Stage(const ReplayLog& log, SpecFolders folders, bool from_log)
      : text_(log.spec_text),
        folders_(std::move(folders)),
        spec_(parse_spec(log.spec_text, log.spec_file, folders_)) {
    // Only the log of a replay is wanted.
    spec_.pictures = false;
    spec_.videos = Recorded::kNone;
    spec_.frames.of = Recorded::kNone;
    spec_.replays.images = false;
    const bool needs_weights =
        !from_log && std::any_of(spec_.arms.begin(), spec_.arms.end(), [](const ArmSpec& arm) {
          return arm.detector != ArmDetector::kOracle;
        });
    if (needs_weights) {
      std::vector<fs::path> bundles;
      std::vector<Starts> starts;
      for (const SceneSpec& scene : spec_.scenes) {
        bundles.push_back(prepare_scene(spec_, scene, folders_.work));
        starts.push_back(starts_of(load(scene)));
      }
      detectors_ = prepare_detectors(spec_, bundles, starts, folders_.work);
    }
    runner_ = std::make_unique<TrialRunner>(spec_, detectors_, scratch_.path());
  }

  [[nodiscard]] bool fits(const ReplayLog& log, const fs::path& work) const {
    return log.spec_text == text_ && work == folders_.work;
  }

  /// The trial again. @throws core::InputError if what it needs is not what it was.
  ReplayLog play(const ReplayLog& log, const fs::path& file, bool from_log) {
    const ArmSpec* arm = spec_.find_arm(log.arm);
    if (arm == nullptr) {
      throw core::InputError::expected(file.string(), "an arm of its spec", log.arm);
    }
    const LoadedScene& scene = load(log, file);
    const auto episode =
        std::find_if(scene.episodes.episodes.begin(), scene.episodes.episodes.end(),
                     [&](const sim::Episode& e) { return e.id == log.episode; });
    if (episode == scene.episodes.episodes.end()) {
      throw core::InputError::expected(file.string(), "an episode of its scene", log.episode);
    }
    TrialTask task;
    task.scene = &scene;
    task.episode = &*episode;
    task.arm = arm;
    task.repetition = log.repetition;
    task.replay_log = true;
    task.replay = &log;
    task.replay_perception = from_log;
    if (from_log && log.images) task.replay_images = replay_images(file);
    const TrialRow row = runner_->run(task);
    if (row.failed()) throw core::InputError(file.string() + ": " + row.error);
    return read_replay_log(only_log());
  }

 private:
  const LoadedScene& load(const SceneSpec& wanted) {
    auto& scene = scenes_[wanted.name];
    if (scene == nullptr) {
      scene = std::make_unique<LoadedScene>(load_scene(
          spec_, wanted, prepare_scene(spec_, wanted, folders_.work), folders_.work));
    }
    return *scene;
  }

  const LoadedScene& load(const ReplayLog& log, const fs::path& file) {
    const SceneSpec* wanted = spec_.find_scene(log.scene);
    if (wanted == nullptr) {
      throw core::InputError::expected(file.string(), "a scene of its spec", log.scene);
    }
    const LoadedScene& scene = load(*wanted);
    if (scene.bundle.scene_sha256 != log.scene_sha256) {
      throw core::InputError::expected(file.string(), "the scene as it was when the trial ran",
                                       "another bundle in " + scene.bundle.folder.string());
    }
    return scene;
  }

  /// The log that the replay wrote; it is taken away for the next one.
  fs::path only_log() const {
    const fs::path kept = scratch_.path() / "log.jsonl";
    for (const auto& entry : fs::recursive_directory_iterator(scratch_.path() / "replays")) {
      if (entry.path().extension() == ".jsonl") fs::rename(entry.path(), kept);
    }
    return kept;
  }

  std::string text_;
  SpecFolders folders_;
  ExperimentSpec spec_;
  PreparedDetectors detectors_;
  Scratch scratch_;
  std::unique_ptr<TrialRunner> runner_;
  std::map<std::string, std::unique_ptr<LoadedScene>> scenes_;
};

/// @return  Whether the replay equals the record.
bool report(const fs::path& file, const ReplayLog& recorded, const ReplayLog& replayed) {
  const Divergence found = first_divergence(recorded.ticks, replayed.ticks);
  const std::string sensor = first_differing_sensor(recorded.sensors, replayed.sensors);
  if (found.tick < 0 && !sensor.empty()) {
    std::printf("%s: differs in the readings of %s, in no tick\n", file.c_str(),
                sensor.c_str());
    return false;
  }
  if (found.tick < 0) {
    std::printf("%s: equal, %zu ticks, %s, hash %016llx\n", file.c_str(),
                replayed.ticks.size(), replayed.outcome.c_str(),
                static_cast<unsigned long long>(replayed.state_hash));
    return true;
  }
  std::printf("%s: differs from tick %d on: %s recorded %s, replayed %s\n", file.c_str(),
              found.tick, found.field.c_str(), found.recorded.c_str(), found.replayed.c_str());
  if (recorded.code_version != core::version()) {
    std::printf("  (recorded by segsim %s, this is %s)\n", recorded.code_version.c_str(),
                core::version());
  }
  return false;
}

void replay(const ReplayFlags& flags) {
  std::unique_ptr<Stage> stage;
  int different = 0;
  const std::vector<fs::path> files = log_files(flags.paths);
  for (const fs::path& file : files) {
    const ReplayLog log = read_replay_log(file);
    SpecFolders folders = flags.folders;
    if (folders.work.empty()) folders.work = work_of(file);
    if (stage == nullptr || !stage->fits(log, folders.work)) {
      stage.reset();  // Its scratch folder has the same name.
      stage = std::make_unique<Stage>(log, folders, flags.from_log);
    }
    if (!report(file, log, stage->play(log, file, flags.from_log))) ++different;
  }
  if (flags.verify && different > 0) {
    throw core::CheckFailed(std::to_string(different) + " of " + std::to_string(files.size()) +
                            " trials differ from their record");
  }
}

}  // namespace

void add_replay_command(CLI::App& app) {
  auto flags = std::make_shared<ReplayFlags>();
  CLI::App* command = app.add_subcommand(
      "replay", "Run recorded trials again and name the first tick and field that differ");
  command
      ->add_option("log", flags->paths,
                   "Logs (<work>/replays/<scene>/<episode>.<arm>.jsonl) or folders of them")
      ->required();
  command->add_flag("--verify", flags->verify, "Exit code 1 if a trial differs");
  command->add_flag("--from-log", flags->from_log,
                    "Take detections from the log (no weights needed), and images too if they "
                    "were kept (no renderer needed)");
  command->add_option("--data", flags->folders.data,
                      "Folder that ${data} in the spec stands for");
  command->add_option("--work", flags->folders.work,
                      "Work folder of the run (default: the one that the log lies in)");
  command->callback([flags] { replay(*flags); });
}

}  // namespace segsim::experiments
