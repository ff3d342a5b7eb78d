// `segsim record`: a trial as ROS 2 messages in an MCAP file.
#include <cstdio>
#include <memory>
#include <string>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "experiments/bags/record_trial.h"
#include "experiments/commands/commands.h"
#include "experiments/records/replay_log.h"
#include "experiments/results/stored_run.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct RecordFlags {
  fs::path trial, output;
  std::int64_t number = 0, run_id = 0;
  std::string compression = "lz4";
  specs::SpecFolders folders;
};

/// The log of the trial that the flags name.
fs::path log_of(const RecordFlags& flags) {
  if (flags.trial.extension() == ".jsonl") return flags.trial;
  const results::StoredRun stored = results::load_run(flags.trial, flags.run_id);
  for (const records::TrialRow& row : stored.trials) {
    if (row.trial_id != flags.number) continue;
    fs::path log = records::replay_log_of(stored.folder, row);
    if (!log.empty() && fs::exists(log)) return log;
    throw core::InputError::expected("trial " + std::to_string(flags.number),
                                     "a log to play again (replays: {of: all} in the spec)",
                                     "none");
  }
  throw core::InputError::expected("--trial",
                                   "the number of one of " +
                                       std::to_string(stored.trials.size()) +
                                       " trials (`segsim explain` and trials.csv list them)",
                                   std::to_string(flags.number));
}

ros::mcap::Compression compression_of(const std::string& name) {
  using ros::mcap::Compression;
  for (const Compression one : {Compression::kLz4, Compression::kZstd}) {
    if (name == to_string(one)) return one;
  }
  return Compression::kNone;
}

void record(const RecordFlags& flags) {
  const bags::BagSummary summary = bags::record_trial(
      log_of(flags), flags.folders, flags.output, compression_of(flags.compression));
  std::printf("%s: %d messages, %d images, %.1f s, %.1f MB\n", flags.output.c_str(),
              summary.messages, summary.images, summary.duration_s,
              static_cast<double>(fs::file_size(flags.output)) / 1e6);
}

}  // namespace

void add_record_command(CLI::App& app) {
  auto flags = std::make_shared<RecordFlags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "record");
  command
      ->add_option(
          "trial", flags->trial,
          "Log of the trial (<work>/replays/<scene>/<episode>.<arm>.jsonl); or the work "
          "folder of `segsim run`, with --trial")
      ->required();
  command->add_option("--trial", flags->number, "Number of the trial in that run");
  command->add_option("--mcap", flags->output, "File to write")->required();
  command->add_option("--compression", flags->compression, "Of its chunks")
      ->check(CLI::IsMember({"none", "lz4", "zstd"}))
      ->capture_default_str();
  command->add_option("--data", flags->folders.data,
                      "Folder that ${data} in the spec stands for");
  command->add_option("--work", flags->folders.work,
                      "Work folder of the run (default: the one that the log lies in)");
  command->add_option("--run", flags->run_id, "Number of the run (default: the last)");
  command->callback([flags] { record(*flags); });
}

}  // namespace segsim::experiments::commands
