// `segsim explain`: why did this trial fail?
#include <cstdio>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/scene_bundle.h"
#include "experiments/commands/commands.h"
#include "experiments/drawing/floor_plan.h"
#include "experiments/results/explanation.h"
#include "experiments/results/stored_run.h"
#include "experiments/scenes/scene_surfels.h"
#include "perception/data/image_file.h"
#include "renderer/cpu_renderer.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct Flags {
  fs::path work, out;
  std::string trial, arm;
  std::int64_t run_id = 0;
  bool pictures = true;
};

void list_failures(const std::vector<records::TrialRow>& rows) {
  std::printf("%6s  %-32s %-18s %-24s %s\n", "trial", "episode", "arm", "cause", "outcome");
  int failures = 0;
  for (const records::TrialRow& row : rows) {
    if (row.success || !row.counts()) continue;
    ++failures;
    std::printf("%6lld  %-32s %-18s %-24s %s\n", static_cast<long long>(row.trial_id),
                row.episode.c_str(), row.arm.c_str(),
                row.why.known() ? to_string(*row.why.cause) : "(not attributed)",
                to_string(row.outcome));
  }
  std::printf("%d of %zu trials failed; give a number to read its story\n", failures,
              rows.size());
}

const records::TrialRow& chosen_trial(const Flags& flags,
                                      const std::vector<records::TrialRow>& rows) {
  std::vector<const records::TrialRow*> fitting;
  for (const records::TrialRow& row : rows) {
    if (!flags.arm.empty() && row.arm != flags.arm) continue;
    if (std::to_string(row.trial_id) == flags.trial || row.episode == flags.trial) {
      fitting.push_back(&row);
    }
  }
  if (fitting.size() == 1) return *fitting.front();
  if (fitting.empty()) {
    throw core::InputError::expected(
        "TRIAL",
        "the number or the episode of one of " + std::to_string(rows.size()) +
            " trials (without TRIAL they are listed)",
        "\"" + flags.trial + "\"" + (flags.arm.empty() ? "" : " of arm " + flags.arm));
  }
  std::string found;
  for (const records::TrialRow* row : fitting) {
    found += (found.empty() ? "" : ", ") + std::to_string(row->trial_id) + " (arm " +
             row->arm + ")";
  }
  throw core::InputError::expected("TRIAL", "one trial (give its number, or --arm)", found);
}

void draw(const Flags& flags, const fs::path& folder, const records::TrialRow& row,
          const records::TrialLog& log) {
  const fs::path bundle_folder = log.bundle.is_absolute() ? log.bundle : folder / log.bundle;
  const core::SceneBundle bundle = core::load_bundle(bundle_folder);
  const scenes::SceneSurfels scene = scenes::load_scene_surfels(bundle);
  const auto renderer = renderer::make_cpu_renderer(scene.surfels, {}, scene.labels);
  const fs::path out = flags.out.empty() ? folder / "explain" : flags.out;
  const std::string stem = "trial-" + std::to_string(row.trial_id);
  perception::write_image(out / (stem + "-map.png"),
                          results::draw_story_map(row, log, bundle.manifest,
                                                  drawing::make_floor_plan(*scene.surfels)));
  perception::write_image(out / (stem + "-frames.png"),
                          results::draw_story_frames(row, log, bundle.manifest, *renderer));
  std::printf("  pictures    %s, %s\n", (out / (stem + "-map.png")).c_str(),
              (out / (stem + "-frames.png")).c_str());
}

void explain(const Flags& flags) {
  const results::StoredRun stored = results::load_run(flags.work, flags.run_id);
  const std::vector<records::TrialRow>& rows = stored.trials;
  if (flags.trial.empty()) {
    list_failures(rows);
    return;
  }
  const records::TrialRow& row = chosen_trial(flags, rows);
  if (row.log.empty()) {
    const std::string outcome = to_string(row.outcome);
    const std::string why = row.error.empty() ? outcome : outcome + ": " + row.error;
    throw core::InputError::expected(
        "trial " + std::to_string(row.trial_id), "a trial with a log",
        row.why.known() ? "none (" + why + ")" : "one of an older version, without any");
  }
  const fs::path& folder = stored.folder;
  const records::TrialLog log = records::read_trial_log(folder / row.log);
  for (const std::string& line : results::tell_story(row, log))
    std::printf("%s\n", line.c_str());
  if (flags.pictures) draw(flags, folder, row, log);
}

}  // namespace

void add_explain_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "explain");
  command->add_option("run", flags->work, "Work folder of `segsim run`, or a results database")
      ->required();
  command->add_option("trial", flags->trial,
                      "Number of the trial, or its episode (with --arm if several ran it)");
  command->add_option("--arm", flags->arm, "Arm of the trial");
  command->add_option("--run", flags->run_id, "Number of the run (default: the last)");
  command->add_option("--out", flags->out,
                      "Folder for the pictures (default: explain/ in the work folder)");
  command->add_flag("!--no-pictures", flags->pictures, "Text only; needs no bundle");
  command->callback([flags] { explain(*flags); });
}

}  // namespace segsim::experiments::commands
