#include "experiments/runs/trial_replay.h"

#include <algorithm>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/error.h"
#include "core/process/temporary_folder.h"
#include "experiments/runs/prepare.h"
#include "experiments/trials/trial_runner.h"

namespace segsim::experiments::runs {

namespace fs = std::filesystem;

fs::path work_of_replay(const fs::path& log_file) {
  for (fs::path folder = fs::absolute(log_file).parent_path(); folder.has_relative_path();
       folder = folder.parent_path()) {
    if (folder.filename() == "replays") return folder.parent_path();
  }
  throw core::InputError::expected(log_file.string(), "a log below <work>/replays, or --work",
                                   "another place");
}

struct TrialReplay::Impl {
  Impl(const records::ReplayLog& log, specs::SpecFolders of, bool use_log)
      : text(log.spec_text),
        folders(std::move(of)),
        from_log(use_log),
        spec(specs::parse_spec(log.spec_text, log.spec_file, folders)) {
    // Only the log of a replay is wanted.
    spec.pictures = false;
    spec.videos = specs::Recorded::kNone;
    spec.frames.of = specs::Recorded::kNone;
    spec.replays.images = false;
    const bool needs_weights =
        !from_log &&
        std::any_of(spec.arms.begin(), spec.arms.end(), [](const specs::ArmSpec& arm) {
          return arm.detector != specs::ArmDetector::kOracle;
        });
    trials::PreparedDetectors detectors;
    if (needs_weights) {
      support::StageTimes times;
      Inputs inputs = prepare_inputs(spec, folders.work, 1, times);
      for (trials::LoadedScene& scene : inputs.scenes) {
        const std::string name = scene.spec->name;
        scenes[name] = std::make_unique<trials::LoadedScene>(std::move(scene));
      }
      detectors = std::move(inputs.detectors);
    }
    runner = std::make_unique<trials::TrialRunner>(spec, detectors, scratch.path());
  }

  const trials::LoadedScene& load(const specs::SceneSpec& wanted) {
    auto& scene = scenes[wanted.name];
    if (scene == nullptr) {
      scene = std::make_unique<trials::LoadedScene>(trials::load_scene(
          spec, wanted, prepare_scene(spec, wanted, folders.work), folders.work));
    }
    return *scene;
  }

  const trials::LoadedScene& scene_of(const records::ReplayLog& log, const fs::path& file) {
    const specs::SceneSpec* wanted = spec.find_scene(log.scene);
    if (wanted == nullptr) {
      throw core::InputError::expected(file.string(), "a scene of its spec", log.scene);
    }
    const trials::LoadedScene& scene = load(*wanted);
    if (scene.bundle.scene_sha256 != log.scene_sha256) {
      throw core::InputError::expected(file.string(), "the scene as it was when the trial ran",
                                       "another bundle in " + scene.bundle.folder.string());
    }
    return scene;
  }

  /// The log that the replay wrote; it is taken away for the next one.
  [[nodiscard]] fs::path only_log() const {
    fs::path kept = scratch.path() / "log.jsonl";
    for (const auto& entry : fs::recursive_directory_iterator(scratch.path() / "replays")) {
      if (entry.path().extension() == ".jsonl") fs::rename(entry.path(), kept);
    }
    return kept;
  }

  std::string text;
  specs::SpecFolders folders;
  bool from_log;
  specs::ExperimentSpec spec;
  core::TemporaryFolder scratch{"segsim_replay"};
  std::map<std::string, std::unique_ptr<trials::LoadedScene>> scenes;
  std::unique_ptr<trials::TrialRunner> runner;
};

TrialReplay::TrialReplay(const records::ReplayLog& log, specs::SpecFolders folders,
                         bool from_log)
    : impl_(std::make_unique<Impl>(log, std::move(folders), from_log)) {}

TrialReplay::~TrialReplay() = default;

bool TrialReplay::fits(const records::ReplayLog& log, const fs::path& work) const {
  return log.spec_text == impl_->text && work == impl_->folders.work;
}

records::ReplayLog TrialReplay::play(const records::ReplayLog& log, const fs::path& file,
                                     trials::TrialViewer* viewer) {
  const specs::ArmSpec* arm = impl_->spec.find_arm(log.arm);
  if (arm == nullptr) {
    throw core::InputError::expected(file.string(), "an arm of its spec", log.arm);
  }
  const trials::LoadedScene& scene = impl_->scene_of(log, file);
  const auto episode =
      std::find_if(scene.episodes.episodes.begin(), scene.episodes.episodes.end(),
                   [&](const sim::Episode& e) { return e.id == log.episode; });
  if (episode == scene.episodes.episodes.end()) {
    throw core::InputError::expected(file.string(), "an episode of its scene", log.episode);
  }
  trials::TrialTask task;
  task.scene = &scene;
  task.episode = &*episode;
  task.arm = arm;
  task.repetition = log.repetition;
  task.replay_log = true;
  task.replay = &log;
  task.replay_perception = impl_->from_log;
  task.record = false;
  task.viewer = viewer;
  if (impl_->from_log && log.images && viewer == nullptr) {
    task.replay_images = records::replay_images(file);
  }
  const records::TrialRow row = impl_->runner->run(task);
  if (row.failed()) throw core::InputError(file.string() + ": " + row.error);
  return records::read_replay_log(impl_->only_log());
}

}  // namespace segsim::experiments::runs
