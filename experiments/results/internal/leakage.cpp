#include "experiments/results/internal/leakage.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "experiments/results/internal/table_notes.h"

namespace segsim::experiments::internal {
namespace {

/// In the order of how much they forbid to conclude.
enum class Leakage : std::uint8_t { kNone, kUnknown, kScene };

Leakage leakage_of(const ArmRow& arm, const SceneRow& scene) {
  if (arm.weights_sha256.empty()) return Leakage::kNone;
  if (is_tuned_on(arm, scene.name)) return Leakage::kScene;
  if (!arm.exposure || arm.exposure->known != TrainingDataKnown::kAll)
    return Leakage::kUnknown;
  const std::vector<std::string>& same = arm.exposure->same_name;
  const bool alike = std::find(same.begin(), same.end(), scene.name) != same.end();
  return alike ? Leakage::kUnknown : Leakage::kNone;
}

Leakage worst_of(const ArmRow& arm, std::span<const SceneRow> scenes) {
  Leakage worst = Leakage::kNone;
  for (const SceneRow& scene : scenes) worst = std::max(worst, leakage_of(arm, scene));
  return worst;
}

std::string word_for(Leakage leakage) {
  constexpr const char* kWords[] = {"none", "unknown", "scene"};
  return kWords[static_cast<std::size_t>(leakage)];
}

std::string quoted(const ArmRow& arm) { return "\"" + arm.name + "\""; }

/// "a", "b" and "c"
std::string listed(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (i > 0) text += i + 1 == words.size() ? " and " : ", ";
    text += words[i];
  }
  return text;
}

/// Titles of the scenes that the arm was trained on.
std::vector<std::string> tuned_titles(const ResultTable& table, const ArmRow& arm) {
  std::vector<std::string> titles;
  for (const SceneRow& scene : table.scene_rows) {
    if (is_tuned_on(arm, scene.name)) titles.push_back(scene.title);
  }
  return titles;
}

/// One note for all arms that were trained on the same scenes; "after" has its own.
void note_tuned(ResultTable& table) {
  std::vector<std::pair<std::vector<std::string>, std::vector<std::string>>> arms_of_titles;
  for (const ArmRow& arm : table.arm_rows) {
    std::vector<std::string> titles = tuned_titles(table, arm);
    if (titles.empty()) continue;
    if (arm.name == table.after && !table.before.empty()) {
      table.notes.push_back(
          "LEAKAGE scene (*): " + quoted(arm) +
          " was fine-tuned on views rendered from the scenes marked * (this is the "
          "adaptation under test; it says nothing about unseen scenes).");
    } else if (!arms_of_titles.empty() && arms_of_titles.back().first == titles) {
      arms_of_titles.back().second.push_back(quoted(arm));
    } else {
      arms_of_titles.push_back({std::move(titles), {quoted(arm)}});
    }
  }
  for (const auto& [titles, arms] : arms_of_titles) {
    table.notes.push_back("LEAKAGE scene: " + listed(arms) +
                          (arms.size() == 1 ? " was" : " were") + " trained on views of " +
                          listed(titles) + ".");
  }
}

void note_unknown(ResultTable& table, const ArmRow& arm) {
  const std::string begin = "LEAKAGE unknown: " + quoted(arm) + " (" + arm.detector + "): ";
  if (!arm.exposure) {
    if (arm.tuned_on.empty()) {
      table.notes.push_back(begin + "these results do not say what it was trained on.");
    }
    return;
  }
  if (arm.exposure->known == TrainingDataKnown::kNothing) {
    table.notes.push_back(begin + "the file does not say what it was trained on.");
  } else if (arm.exposure->known == TrainingDataKnown::kPart) {
    table.notes.push_back(begin + "the file does not say all that it was trained on.");
  }
  if (arm.exposure->same_name.empty()) return;
  table.notes.push_back(begin + "it was trained on a scene of the same name as " +
                        listed(arm.exposure->same_name) +
                        " but another hash, perhaps another reconstruction of the place.");
}

void note_thresholds(ResultTable& table) {
  std::vector<std::string> names;
  for (const ArmRow& arm : table.arm_rows) {
    // One that the spec gives takes the place of the one that was chosen.
    const bool chosen = arm.exposure && !arm.exposure->threshold_on.empty();
    if (chosen && arm.score_threshold < 0.0) names.push_back(quoted(arm));
  }
  if (names.empty()) return;
  table.notes.push_back((names.size() == 1
                             ? "The score threshold of " + names[0] + " was"
                             : "Score thresholds of " + listed(names) + " were") +
                        " chosen on other views of the same scenes.");
}

}  // namespace

bool is_tuned_on(const ArmRow& arm, const std::string& scene) {
  if (arm.exposure && arm.exposure->is_trained_on(scene)) return true;
  const std::string all = ", " + arm.tuned_on + ", ";
  return all.find(", " + scene + ", ") != std::string::npos;
}

std::string leakage_word(const ArmRow& arm, std::span<const SceneRow> scenes) {
  return word_for(worst_of(arm, scenes));
}

std::string leakage_word(const ResultTable& table, std::span<const SceneRow> scenes) {
  const ArmRow* after = table.before.empty() ? nullptr : find_arm(table.arm_rows, table.after);
  if (after != nullptr) return leakage_word(*after, scenes);
  Leakage worst = Leakage::kNone;
  for (const ArmRow& arm : table.arm_rows) worst = std::max(worst, worst_of(arm, scenes));
  return word_for(worst);
}

void note_leakage(ResultTable& table) {
  note_tuned(table);
  std::vector<std::string> clean;
  for (const ArmRow& arm : table.arm_rows) {
    if (arm.weights_sha256.empty()) continue;
    if (worst_of(arm, table.scene_rows) == Leakage::kNone) {
      clean.push_back(quoted(arm));
    } else {
      note_unknown(table, arm);
    }
  }
  if (!clean.empty()) {
    table.notes.push_back("Leakage none: no view of the evaluation scenes is in what " +
                          listed(clean) + (clean.size() == 1 ? " was" : " were") +
                          " trained on.");
  }
  note_thresholds(table);
}

}  // namespace segsim::experiments::internal
