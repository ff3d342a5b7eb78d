// `segsim video`: trials of a run to look at.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "experiments/commands/commands.h"
#include "experiments/films/demo_video.h"
#include "experiments/films/run_video.h"
#include "experiments/results/stored_run.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct Flags {
  fs::path work;
  std::int64_t run_id = 0;
  std::int64_t trial = 0;
  std::vector<std::string> pair;
  bool demo = false;
  films::DemoOptions options;
};

const records::TrialRow& trial_of(const results::StoredRun& stored, std::int64_t number) {
  for (const records::TrialRow& row : stored.trials) {
    if (row.trial_id == number) return row;
  }
  throw core::InputError::expected("--trial",
                                   "the number of one of " +
                                       std::to_string(stored.trials.size()) +
                                       " trials (`segsim explain` and trials.csv list them)",
                                   std::to_string(number));
}

/// The trial of the same episode and repetition in another arm.
const records::TrialRow& same_episode(const results::StoredRun& stored,
                                      const records::TrialRow& trial, const std::string& arm) {
  for (const records::TrialRow& row : stored.trials) {
    if (row.episode == trial.episode && row.repetition == trial.repetition && row.arm == arm) {
      return row;
    }
  }
  throw core::InputError::expected("--pair", "an arm that ran " + trial.episode, arm);
}

void write_video(Flags& flags) {
  const results::StoredRun stored = results::load_run(flags.work, flags.run_id);
  films::VideoOptions& options = flags.options.video;
  if (!flags.demo && flags.trial == 0) {
    throw core::InputError::expected("segsim video", "--trial or --demo", "neither");
  }
  const std::string stem = flags.demo ? "demo" : "trial-" + std::to_string(flags.trial);
  if (options.output.empty()) {
    options.output =
        stored.folder / "videos" / (stem + (flags.pair.empty() ? "" : "-pair") + ".mp4");
  }
  films::VideoSummary summary;
  if (flags.demo) {
    summary = films::write_demo_video(stored, flags.options);
  } else if (!flags.pair.empty()) {
    const records::TrialRow& trial = trial_of(stored, flags.trial);
    summary = films::write_pair_video(stored, same_episode(stored, trial, flags.pair.at(0)),
                                      same_episode(stored, trial, flags.pair.at(1)), options);
  } else {
    summary = films::write_trial_video(stored, trial_of(stored, flags.trial), options);
  }
  if (summary.copied) {
    std::printf("%s: as the run recorded it (it left no log to play)\n",
                options.output.c_str());
    return;
  }
  std::printf("%s: %d frames, %.0f s, %.1f MB\n", options.output.c_str(), summary.frames,
              summary.duration_s, static_cast<double>(fs::file_size(options.output)) / 1e6);
}

}  // namespace

void add_video_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "video");
  command->add_option("run", flags->work, "Work folder of `segsim run`, or a results database")
      ->required();
  CLI::Option* trial = command->add_option("--trial", flags->trial, "Number of the trial");
  command
      ->add_option("--pair", flags->pair,
                   "Two arms side by side, in the episode of --trial: --pair before after")
      ->expected(2)
      ->needs(trial);
  command
      ->add_flag("--demo", flags->demo,
                 "The question, pairs of trials, and the rates, in about 75 s")
      ->excludes(trial);
  command->add_option("-o,--output", flags->options.video.output,
                      "File (default: videos/ in the work folder)");
  command
      ->add_option("--speed", flags->options.video.speed,
                   "Simulated over shown time (in a demo the least)")
      ->check(CLI::Range(0.1, 100.0))
      ->capture_default_str();
  command->add_option("--data", flags->options.video.data,
                      "Folder that ${data} in the spec stands for");
  command->add_option("--run", flags->run_id, "Number of the run (default: the last)");
  command->add_option("--before", flags->options.before, "Of a demo: arm to compare from");
  command->add_option("--after", flags->options.after, "Of a demo: arm to compare with");
  command->callback([flags] { write_video(*flags); });
}

}  // namespace segsim::experiments::commands
