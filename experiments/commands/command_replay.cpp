// `segsim replay`: runs recorded trials again and compares them tick by tick.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/version.h"
#include "experiments/commands/commands.h"
#include "experiments/records/replay_log.h"
#include "experiments/runs/trial_replay.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct ReplayFlags {
  std::vector<fs::path> paths;
  specs::SpecFolders folders;
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

/// @return  Whether the replay equals the record.
bool report(const fs::path& file, const records::ReplayLog& recorded,
            const records::ReplayLog& replayed) {
  const records::Divergence found = records::first_divergence(recorded.ticks, replayed.ticks);
  const std::string sensor =
      records::first_differing_sensor(recorded.sensors, replayed.sensors);
  if (found.tick < 0 && !sensor.empty()) {
    std::printf("%s: differs in the readings of %s, in no tick\n", file.c_str(),
                sensor.c_str());
    return false;
  }
  if (found.tick < 0) {
    std::printf("%s: equal, %zu ticks, %s, hash %016llx\n", file.c_str(),
                replayed.ticks.size(), sim::to_string(replayed.outcome),
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
  std::unique_ptr<runs::TrialReplay> stage;
  int different = 0;
  const std::vector<fs::path> files = log_files(flags.paths);
  for (const fs::path& file : files) {
    const records::ReplayLog log = records::read_replay_log(file);
    specs::SpecFolders folders = flags.folders;
    if (folders.work.empty()) folders.work = runs::work_of_replay(file);
    if (stage == nullptr || !stage->fits(log, folders.work)) {
      stage = std::make_unique<runs::TrialReplay>(log, folders, flags.from_log);
    }
    if (!report(file, log, stage->play(log, file))) ++different;
  }
  if (flags.verify && different > 0) {
    throw core::CheckFailed(std::to_string(different) + " of " + std::to_string(files.size()) +
                            " trials differ from their record");
  }
}

}  // namespace

void add_replay_command(CLI::App& app) {
  auto flags = std::make_shared<ReplayFlags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "replay");
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

}  // namespace segsim::experiments::commands
