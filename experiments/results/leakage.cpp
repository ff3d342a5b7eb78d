#include "experiments/results/leakage.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "experiments/results/table_grids.h"

namespace segsim::experiments::results::internal {
namespace {

/// In the order of how much they forbid to conclude.
enum class Leakage : std::uint8_t { kNone, kUnknown, kScene };

using ArmRows = std::vector<const records::ArmRow*>;
using SceneRows = std::vector<const records::SceneRow*>;

bool has(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Whether views of the scene are known to have been trained on.
bool row_is_tuned_on(const records::ArmRow& arm, const std::string& scene) {
  if (arm.exposure && arm.exposure->is_trained_on(scene)) return true;
  const std::string all = ", " + arm.tuned_on + ", ";
  return all.find(", " + scene + ", ") != std::string::npos;
}

Leakage leakage_of(const records::ArmRow& arm, const records::SceneRow& scene) {
  if (arm.weights_sha256.empty()) return Leakage::kNone;
  if (row_is_tuned_on(arm, scene.name)) return Leakage::kScene;
  if (!arm.exposure || arm.exposure->known != records::TrainingDataKnown::kAll)
    return Leakage::kUnknown;
  return has(arm.exposure->same_name, scene.name) ? Leakage::kUnknown : Leakage::kNone;
}

Leakage worst_of(const ArmRows& arms, const SceneRows& scenes) {
  Leakage worst = Leakage::kNone;
  for (const records::ArmRow* arm : arms) {
    for (const records::SceneRow* scene : scenes)
      worst = std::max(worst, leakage_of(*arm, *scene));
  }
  return worst;
}

std::string word_for(Leakage leakage) {
  constexpr const char* kWords[] = {"none", "unknown", "scene"};
  return kWords[static_cast<std::size_t>(leakage)];
}

/// All trainings of an arm, or the one row of that name.
ArmRows rows_of(const ResultTable& table, const std::string& arm) {
  ArmRows rows;
  for (const records::ArmRow& row : table.arm_rows) {
    if (records::family_of(row) == arm) rows.push_back(&row);
  }
  if (!rows.empty()) return rows;
  for (const records::ArmRow& row : table.arm_rows) {
    if (row.name == arm) rows.push_back(&row);
  }
  return rows;
}

/// @param family  Empty: all.
SceneRows scenes_of(const ResultTable& table, const std::string& family) {
  SceneRows scenes;
  for (const records::SceneRow& scene : table.scene_rows) {
    if (family.empty() || records::family_of(scene) == family) scenes.push_back(&scene);
  }
  return scenes;
}

/// Rows of the arm "after"; none without a comparison.
ArmRows compared_rows(const ResultTable& table) {
  return compares(table) ? rows_of(table, table.after) : ArmRows{};
}

/// What notes say of a row, in terms of the spec's scenes.
struct Finding {
  Leakage worst = Leakage::kNone;
  std::optional<records::TrainingDataKnown> known;  ///< None: nobody looked.
  std::vector<std::string> tuned;                   ///< Titles.
  std::vector<std::string> same_name;               ///< Families.
  bool threshold_chosen = false;

  bool operator==(const Finding&) const = default;
};

Finding finding_of(const ResultTable& table, const records::ArmRow& row) {
  Finding finding;
  finding.worst = worst_of({&row}, scenes_of(table, ""));
  if (row.exposure) finding.known = row.exposure->known;
  for (const records::SceneRow& scene : table.scene_rows) {
    const std::string& family = records::family_of(scene);
    const std::string& title = scenes_of(table, family).front()->title;
    if (row_is_tuned_on(row, scene.name) && !has(finding.tuned, title)) {
      finding.tuned.push_back(title);
    }
    if (row.exposure && has(row.exposure->same_name, scene.name) &&
        !has(finding.same_name, family)) {
      finding.same_name.push_back(family);
    }
  }
  // One that the spec gives takes the place of the one that was chosen.
  const bool chosen = row.exposure && !row.exposure->threshold_on.empty();
  finding.threshold_chosen = chosen && row.score_threshold < 0.0;
  return finding;
}

/// Trainings of an arm of which the same is to say.
struct ToldArm {
  std::string name;
  ArmRows rows;
  Finding finding;
  bool is_whole = true;  ///< Not one of several trainings, of which one has the arm's name.

  [[nodiscard]] std::string quoted() const {
    return "\"" + name + (is_whole ? "\"" : "\" (one training)");
  }
};

/// Arms with weights, in the order of the run.
std::vector<ToldArm> told_arms(const ResultTable& table) {
  std::vector<ToldArm> told;
  for (const records::ArmRow& row : table.arm_rows) {
    if (row.weights_sha256.empty()) continue;
    const Finding finding = finding_of(table, row);
    const ArmRows family = rows_of(table, records::family_of(row));
    const bool alike = std::all_of(
        family.begin(), family.end(),
        [&](const records::ArmRow* other) { return finding_of(table, *other) == finding; });
    if (!alike) {
      told.push_back({row.name, {&row}, finding, false});
    } else if (family.front() == &row) {
      told.push_back({records::family_of(row), family, finding});
    }
  }
  return told;
}

/// Whether the arm has other weights in every scene.
bool has_own_weights(const ResultTable& table, const ToldArm& arm) {
  const auto first =
      table.run.provenance.lower_bound("weights/" + arm.rows.front()->name + "/");
  return first != table.run.provenance.end() &&
         first->first.starts_with("weights/" + arm.rows.front()->name + "/");
}

/// "a", "b" and "c"
std::string listed(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (i > 0) text += i + 1 == words.size() ? " and " : ", ";
    text += words[i];
  }
  return text;
}

/// One note for all arms that were trained on the same scenes; "after" has its own.
void note_tuned(ResultTable& table, const std::vector<ToldArm>& told) {
  if (std::any_of(table.scenes.begin(), table.scenes.end(),
                  [](const GroupSummary& scene) { return scene.leak; })) {
    table.notes.push_back(
        "LEAKAGE scene (*): \"" + table.after +
        "\" was fine-tuned on views rendered from the scenes marked * (this is the "
        "adaptation under test; it says nothing about unseen scenes).");
  }
  std::vector<std::pair<std::vector<std::string>, std::vector<std::string>>> arms_of_titles;
  for (const ToldArm& arm : told) {
    const std::vector<std::string>& titles = arm.finding.tuned;
    if (titles.empty() || (compares(table) && arm.is_whole && arm.name == table.after))
      continue;
    if (!arms_of_titles.empty() && arms_of_titles.back().first == titles) {
      arms_of_titles.back().second.push_back(arm.quoted());
    } else {
      arms_of_titles.push_back({titles, {arm.quoted()}});
    }
  }
  for (const auto& [titles, arms] : arms_of_titles) {
    table.notes.push_back("LEAKAGE scene: " + listed(arms) +
                          (arms.size() == 1 ? " was" : " were") + " trained on views of " +
                          listed(titles) + ".");
  }
}

void note_unknown(ResultTable& table, const ToldArm& arm) {
  const bool one = arm.rows.size() == 1;
  const std::string begin =
      "LEAKAGE unknown: " + arm.quoted() + " (" +
      (one ? arm.rows.front()->detector : std::to_string(arm.rows.size()) + " files") + "): ";
  const std::string files_do = one ? "the file does" : "the files do";
  const Finding& finding = arm.finding;
  if (!finding.known) {
    if (finding.tuned.empty()) {
      table.notes.push_back(begin + "these results do not say what it was trained on.");
    }
    return;
  }
  if (*finding.known == records::TrainingDataKnown::kNothing) {
    table.notes.push_back(begin + files_do + " not say what it was trained on.");
  } else if (*finding.known == records::TrainingDataKnown::kPart) {
    table.notes.push_back(begin + files_do + " not say all that it was trained on.");
  }
  if (finding.same_name.empty()) return;
  table.notes.push_back(begin + "it was trained on a scene of the same name as " +
                        listed(finding.same_name) +
                        " but another hash, perhaps another reconstruction of the place.");
}

void note_thresholds(ResultTable& table, const std::vector<ToldArm>& told) {
  std::vector<std::string> names;
  bool one = true;
  for (const ToldArm& arm : told) {
    if (!arm.finding.threshold_chosen) continue;
    names.push_back(arm.quoted());
    one = names.size() == 1 && arm.rows.size() == 1;
  }
  if (names.empty()) return;
  table.notes.push_back((one ? "The score threshold of " + names[0] + " was"
                             : "Score thresholds of " + listed(names) + " were") +
                        " chosen on other views of the same scenes.");
}

}  // namespace

bool is_tuned_on(const ResultTable& table, const std::string& scene) {
  return worst_of(compared_rows(table), scenes_of(table, scene)) == Leakage::kScene;
}

std::string leakage_word(const ResultTable& table, const records::ArmRow& training) {
  return word_for(worst_of({&training}, scenes_of(table, "")));
}

std::string leakage_word(const ResultTable& table, const records::ArmRow& training,
                         const std::string& scene) {
  return word_for(worst_of({&training}, scenes_of(table, scene)));
}

std::string leakage_word(const ResultTable& table, const std::string& arm,
                         const std::string& scene) {
  return word_for(worst_of(rows_of(table, arm), scenes_of(table, scene)));
}

std::string leakage_word(const ResultTable& table, const std::string& arm,
                         const std::vector<std::string>& scenes) {
  Leakage worst = Leakage::kNone;
  for (const std::string& scene : scenes) {
    worst = std::max(worst, worst_of(rows_of(table, arm), scenes_of(table, scene)));
  }
  return word_for(worst);
}

std::string compared_leakage_word(const ResultTable& table, const std::string& scene) {
  ArmRows rows = compared_rows(table);
  if (rows.empty()) {
    for (const records::ArmRow& row : table.arm_rows) rows.push_back(&row);
  }
  return word_for(worst_of(rows, scenes_of(table, scene)));
}

void note_leakage(ResultTable& table) {
  const std::vector<ToldArm> told = told_arms(table);
  note_tuned(table, told);
  std::vector<std::string> clean, clean_by_scene;
  for (const ToldArm& arm : told) {
    if (arm.finding.worst == Leakage::kNone) {
      (has_own_weights(table, arm) ? clean_by_scene : clean).push_back(arm.quoted());
    } else {
      note_unknown(table, arm);
    }
  }
  if (!clean.empty()) {
    table.notes.push_back("Leakage none: no view of the evaluation scenes is in what " +
                          listed(clean) + (clean.size() == 1 ? " was" : " were") +
                          " trained on.");
  }
  if (!clean_by_scene.empty()) {
    table.notes.push_back("Leakage none: " + listed(clean_by_scene) +
                          (clean_by_scene.size() == 1 ? " has" : " have") +
                          " weights of their own in every scene, and no view of that scene "
                          "is in what these were trained on.");
  }
  note_thresholds(table, told);
}

}  // namespace segsim::experiments::results::internal
