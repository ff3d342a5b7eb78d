#include "experiments/scene_labels/label_editor.h"

#include <algorithm>
#include <utility>

#include <glm/common.hpp>

#include "core/error.h"
#include "core/file_io.h"

namespace segsim::experiments::scene_labels {
namespace {

namespace fs = std::filesystem;
using core::InputError;
using Kind = JournalRecord::Kind;

constexpr const char* kEditsPrefix = "label_edits_";
constexpr double kSamePlace_m = 1e-6;  // scene.yaml rounds.

/// The lock makes a folder that is missing, so this is asked first.
const fs::path& existing(const fs::path& folder) {
  if (!fs::exists(folder / "scene.yaml")) static_cast<void>(core::load_bundle(folder));
  return folder;
}

bool same(const core::SceneClass& a, const core::SceneClass& b) {
  return a.id == b.id && a.name == b.name && a.thing == b.thing;
}

bool same(const core::SceneInstance& a, const core::SceneInstance& b) {
  const glm::dvec3 off_m =
      glm::max(glm::abs(a.box_min_m - b.box_min_m), glm::abs(a.box_max_m - b.box_max_m));
  return a.id == b.id && a.class_id == b.class_id && a.name == b.name &&
         std::max({off_m.x, off_m.y, off_m.z}) <= kSamePlace_m;
}

template <class Row>
bool same_rows(const std::vector<Row>& a, const std::vector<Row>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const Row& x, const Row& y) { return same(x, y); });
}

/// Undone and done edits as records leave them.
struct History {
  std::vector<LabelEdit> edits;
  std::size_t applied = 0;

  void follow(const JournalRecord& record, const fs::path& journal) {
    if (record.kind == Kind::kEdit) {
      edits.resize(applied);
      edits.push_back(record.edit);
      ++applied;
      return;
    }
    const bool undoes = record.kind == Kind::kUndo;
    if (undoes ? applied == 0 : applied == edits.size()) {
      throw InputError::expected(journal.string(),
                                 undoes ? "an edit to undo" : "an edit to redo",
                                 "none (" + record.edit.what + ")");
    }
    undoes ? --applied : ++applied;
  }
};

}  // namespace

LabelEditor::LabelEditor(const fs::path& folder)
    : folder_(folder),
      lock_(existing(folder), support::FolderLock::Kind::kExclusive,
            support::FolderLock::IfTaken::kRefuse),
      bundle_(core::load_bundle(folder)),
      parts_(core::load_bundle_parts(folder)),
      unedited_(scenes::load_unedited_surfels(bundle_)) {
  if (!unedited_.surfels->has_labels()) {
    throw InputError::expected(bundle_.surfels_file().string(), "labelled surfels",
                               "no semantic_id property");
  }
  journal_.emplace(folder_ / kJournalFileName, start_of_bundle());
  const std::vector<JournalRecord>& records = journal_->records();
  History history;
  std::size_t applied_before = 0;
  std::vector<LabelEdit> edits_before;
  for (std::size_t k = 0; k < records.size(); ++k) {
    if (k + 1 == records.size()) {
      applied_before = history.applied;
      edits_before = history.edits;
    }
    history.follow(records[k], folder_ / kJournalFileName);
  }
  history_ = std::move(edits_before);
  const LabelState before = state_after(applied_before);
  history_ = std::move(history.edits);
  applied_ = history.applied;
  state_ = state_after(applied_);
  if (bundle_has(*state_)) return;
  if (!bundle_has(before)) {
    throw InputError::expected((folder_ / "scene.yaml").string(),
                               std::string("the labels, classes and instances that ") +
                                   kJournalFileName + " leads to",
                               "others (move the journal away to begin a new one)");
  }
  save();  // A crash came between journal and bundle.
}

JournalStart LabelEditor::start_of_bundle() const {
  JournalStart start{unedited_.surfels->size(),  bundle_.manifest.surfels.sha256,
                     parts_.labels.sha256,       bundle_.manifest.classes,
                     bundle_.manifest.instances, {}};
  if (!parts_.label_edits.name.empty()) {
    start.edits = renderer::read_label_edits(folder_ / parts_.label_edits.name, start.surfels);
  }
  return start;
}

LabelState LabelEditor::state_after(std::size_t edits) const {
  const JournalStart& start = journal_->start();
  LabelState state(*unedited_.surfels, start.classes, start.instances, start.edits);
  for (std::size_t k = 0; k < edits; ++k) state.apply(history_[k]);
  return state;
}

bool LabelEditor::bundle_has(const LabelState& state) const {
  return same_rows(bundle_.manifest.classes, state.classes()) &&
         same_rows(bundle_.manifest.instances, state.instances()) &&
         start_of_bundle().edits == state.label_edits();
}

scenes::SceneSurfels LabelEditor::surfels() const {
  return scenes::edited_surfels(unedited_, state_->label_edits());
}

std::optional<std::string> LabelEditor::undoable() const {
  if (applied_ == 0) return std::nullopt;
  return history_[applied_ - 1].what;
}

std::optional<std::string> LabelEditor::redoable() const {
  if (applied_ == history_.size()) return std::nullopt;
  return history_[applied_].what;
}

std::string LabelEditor::apply(const LabelEdit& edit) { return record({Kind::kEdit, edit}); }

std::string LabelEditor::undo() {
  if (applied_ == 0) throw InputError::expected("undo", "an edit to undo", "none");
  return record({Kind::kUndo, {undoable().value(), {}, {}, {}, {}}});
}

std::string LabelEditor::redo() {
  if (applied_ == history_.size()) {
    throw InputError::expected("redo", "an edit that was undone", "none");
  }
  return record({Kind::kRedo, {redoable().value(), {}, {}, {}, {}}});
}

std::string LabelEditor::record(const JournalRecord& record) {
  refresh_bundle();
  if (!saved_) save();  // So that the bundle is never more than one step behind.
  std::string what = record.edit.what;
  journal_->append(record);
  History history{std::move(history_), applied_};
  history.follow(record, folder_ / kJournalFileName);
  history_ = std::move(history.edits);
  applied_ = history.applied;
  if (record.kind == Kind::kEdit) {
    state_->apply(record.edit);
  } else {
    state_ = state_after(applied_);
  }
  ++revision_;
  saved_ = false;
  save();
  return what;
}

/// Another command may have changed the bundle meanwhile, its navigation mesh for example.
void LabelEditor::refresh_bundle() {
  if (core::sha256_of_file(folder_ / "scene.yaml") == bundle_.scene_sha256) return;
  bundle_ = core::load_bundle(folder_);
  parts_ = core::load_bundle_parts(folder_);
  if (bundle_has(*state_)) return;
  throw InputError::expected((folder_ / "scene.yaml").string(),
                             "the labels, classes and instances that were last written",
                             "others (start segsim scene label again)");
}

void LabelEditor::save() {
  core::SceneManifest manifest = bundle_.manifest;
  manifest.classes = state_->classes();
  manifest.instances = state_->instances();
  core::BundleParts parts = parts_;
  parts.label_edits = {};
  const renderer::LabelEdits edits = state_->label_edits();
  if (!edits.empty()) {
    const fs::path fresh = folder_ / (std::string(kEditsPrefix) + "new.bin");
    renderer::write_label_edits(fresh, edits, unedited_.surfels->size());
    parts.label_edits.name = kEditsPrefix + core::sha256_of_file(fresh).substr(0, 8) + ".bin";
    fs::rename(fresh, folder_ / parts.label_edits.name);
  }
  core::write_bundle_manifest(folder_, manifest, parts);
  for (const auto& entry : fs::directory_iterator(folder_)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(kEditsPrefix) || name == parts.label_edits.name) continue;
    std::error_code ignored;
    fs::remove(entry.path(), ignored);
  }
  bundle_.manifest = std::move(manifest);
  bundle_.scene_sha256 = core::sha256_of_file(folder_ / "scene.yaml");
  parts_ = std::move(parts);
  saved_ = true;
}

}  // namespace segsim::experiments::scene_labels
