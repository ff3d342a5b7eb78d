#include "experiments/report/report.h"

#include <algorithm>
#include <map>
#include <optional>
#include <ostream>
#include <set>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/records/failure_cause.h"
#include "experiments/report/internal/html.h"
#include "experiments/report/internal/report_model.h"
#include "experiments/report/report_assets.h"
#include "experiments/results/table_grids.h"

namespace segsim::experiments::report {
namespace {

namespace fs = std::filesystem;
using internal::ReportModel;
using internal::TrialView;

void write_text(const fs::path& file, const std::string& text) {
  core::write_file_atomically(file, [&](std::ostream& out) { out << text; });
}

/// A folder of its own: new, empty, or that of an earlier report, which is removed.
void clear_output(const fs::path& output) {
  std::error_code error;
  if (!fs::exists(output, error) || fs::is_empty(output, error)) return;
  if (!fs::exists(output / "report.css") || !fs::exists(output / "trials.html")) {
    throw core::InputError::expected(output.string(), "a new folder, or an earlier report",
                                     "other files");
  }
  for (const char* folder : {"episodes", "maps", "pictures", "strips", "videos"}) {
    fs::remove_all(output / folder, error);
  }
  for (const char* file : {"index.html", "trials.html", "report.css", "report.js",
                           "chart.min.js", "table.json", "trials.csv"}) {
    fs::remove(output / file, error);
  }
}

/// A page of its own for each episode, whatever its name.
void name_pages(ReportModel& model) {
  std::map<std::pair<std::string, std::string>, std::string> pages;
  std::set<std::string> taken, anchors;
  for (TrialView& view : model.trials) {
    const auto [at, fresh] = pages.try_emplace({view.row->scene, view.row->episode});
    if (fresh) {
      const std::string stem = internal::file_stem(view.row->episode);
      std::string name = stem;
      for (int n = 2; !taken.insert(name).second; ++n) name = stem + "-" + std::to_string(n);
      at->second = "episodes/" + name + ".html";
    }
    view.page = at->second;
    view.anchor = "trial-" + std::to_string(view.row->trial_id);
  }
}

/// By the rule of summarise(): an arm succeeds in an episode if it does in more than half of
/// its repetitions.
void note_changes(ReportModel& model) {
  if (!results::internal::compares(model.table)) return;
  struct Count {
    int usable = 0, successes = 0;
  };
  std::map<std::string, std::map<std::string, Count>> episodes;
  for (const TrialView& view : model.trials) {
    if (!view.row->counts()) continue;
    Count& count = episodes[view.row->episode][view.row->arm];
    ++count.usable;
    count.successes += view.row->success ? 1 : 0;
  }
  // Of several trainings a trial before them has as many changes, and is told none.
  const bool several = model.table.trainings.size() > 1;
  std::map<std::string, const results::TrainingSummary*> pairs;
  for (const results::TrainingSummary& training : model.table.trainings) {
    pairs[training.arm] = &training;
    if (!several) pairs[training.before] = &training;
  }
  for (TrialView& view : model.trials) {
    const auto pair = pairs.find(view.row->arm);
    if (pair == pairs.end() || !view.row->counts()) continue;
    const Count before = episodes[view.row->episode][pair->second->before];
    const Count after = episodes[view.row->episode][pair->second->arm];
    if (before.usable == 0 || after.usable == 0) continue;
    const bool first = 2 * before.successes > before.usable;
    const bool second = 2 * after.successes > after.usable;
    view.change = first ? (second ? "both" : "lost") : (second ? "gained" : "neither");
  }
}

/// What the table calls the arm and the scene of each trial.
void name_families(ReportModel& model) {
  std::map<std::string, std::string> arms, scenes;
  for (const records::ArmRow& row : model.table.arm_rows) {
    const bool chosen = row.name == model.table.before || row.name == model.table.after;
    arms[row.name] = chosen ? row.name : records::family_of(row);
  }
  for (const records::SceneRow& row : model.table.scene_rows)
    scenes[row.name] = records::family_of(row);
  const auto named = [](const std::map<std::string, std::string>& names,
                        const std::string& name) {
    const auto found = names.find(name);
    return found == names.end() ? name : found->second;
  };
  for (TrialView& view : model.trials) {
    view.arm = named(arms, view.row->arm);
    view.scene = named(scenes, view.row->scene);
  }
}

/// Copies the plot library, if there is one.
bool add_plot_library(const fs::path& output, std::vector<std::string>& notes) {
  const fs::path library = internal::kChartLibrary;
  std::error_code error;
  if (!library.empty() && fs::exists(library, error)) {
    write_text(output / "chart.min.js", core::read_file(library));
    return true;
  }
  notes.emplace_back(
      "No plots: the plot library was not found (Debian: libjs-chart.js); their figures are "
      "here as tables.");
  return false;
}

int write_episodes(const ReportModel& model, const fs::path& output) {
  std::map<std::string, std::vector<const TrialView*>> pages;
  for (const TrialView& view : model.trials) pages[view.page].push_back(&view);
  for (const auto& [page, trials] : pages) {
    write_text(
        output / page,
        internal::html_page(trials.front()->row->episode + " - " + model.stored->run.title,
                            internal::episode_body(model, trials), "../", false));
  }
  return static_cast<int>(pages.size());
}

std::uintmax_t bytes_below(const fs::path& folder) {
  std::uintmax_t bytes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) bytes += entry.file_size();
  }
  return bytes;
}

/// Those beside the results, if they are of this run's spec: `segsim run` writes them at its
/// end.
std::optional<reproducibility::DigestRecord> digests_of(const results::StoredRun& stored) {
  const fs::path file = stored.folder / "digests.json";
  if (stored.folder.empty() || !fs::exists(file)) return std::nullopt;
  reproducibility::DigestRecord found = reproducibility::read_digests(file);
  if (found.spec_sha256 != stored.run.spec_sha256) return std::nullopt;
  return found;
}

}  // namespace

namespace internal {

std::string arm_color(const ReportModel& model, const std::string& arm) {
  static constexpr const char* kOthers[] = {"#8453a8", "#5f6b76", "#0f8b8d",
                                            "#a23b72", "#6b8e23", "#b3261e"};
  std::string family = arm;
  for (const records::ArmRow& row : model.table.arm_rows) {
    if (row.name == arm) family = records::family_of(row);
  }
  for (const std::string& name : {arm, family}) {
    if (name == model.table.before) return "#c26a1b";
    if (name == model.table.after) return "#1f6fb2";
    if (name == model.table.oracle) return "#3a8f4d";
  }
  std::size_t place = 0;
  for (const records::ArmRow& row : model.table.arm_rows) {
    if (records::family_of(row) == family) break;
    ++place;
  }
  return kOthers[place % std::size(kOthers)];
}

std::vector<std::string> arms_of(const ReportModel& model) {
  std::vector<std::string> arms;
  if (model.table.scenes.empty()) return arms;
  for (const results::ArmSummary& arm : model.table.scenes.front().arms)
    arms.push_back(arm.arm);
  return arms;
}

std::string fate_of(const records::TrialRow& trial) {
  if (trial.success) return "success";
  return trial.why.known() ? to_string(*trial.why.cause) : to_string(trial.outcome);
}

std::string fate_in_words(const std::string& fate) {
  const std::optional<records::Cause> cause = records::find_cause(fate);
  return cause ? records::in_words(*cause) : fate;
}

}  // namespace internal

ReportSummary write_report(const results::StoredRun& stored, const ReportOptions& options) {
  ReportModel model;
  model.stored = &stored;
  model.digests = digests_of(stored);
  model.table = results::summarise(stored, options.before, options.after);
  for (const records::TrialRow& trial : stored.trials)
    model.trials.emplace_back().row = &trial;
  clear_output(options.output);

  ReportSummary summary;
  name_families(model);
  name_pages(model);
  note_changes(model);
  model.with_plots = add_plot_library(options.output, model.notes);
  summary.pictures =
      internal::add_pictures(model, options.output, options.pictures, options.threads);

  write_text(options.output / "report.css", internal::kReportCss);
  write_text(options.output / "report.js", internal::kReportJs);
  write_text(options.output / "table.json",
             results::format_table(model.table, support::TableFormat::kJson));
  core::write_file_atomically(options.output / "trials.csv", [&](std::ostream& out) {
    records::write_trials_csv(out, stored.trials);
  });
  summary.pages = 2 + write_episodes(model, options.output);
  const std::string title = stored.run.title.empty() ? stored.run.name : stored.run.title;
  write_text(
      options.output / "trials.html",
      internal::html_page("Trials - " + title, internal::trials_body(model), "", false));
  summary.index = options.output / "index.html";
  write_text(summary.index,
             internal::html_page(title, internal::index_body(model), "", model.with_plots));
  summary.bytes = bytes_below(options.output);
  summary.notes = model.notes;
  return summary;
}

}  // namespace segsim::experiments::report
