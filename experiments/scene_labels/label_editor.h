#pragma once

/// @file
/// Corrects the labels of a bundle: every edit, undo and redo is in the journal and in the
/// bundle before the call returns.
///
/// The files that a scene was made with are not touched. What was set by hand is a file of its
/// own beside them (renderer/files/label_edits.h) under a new name for every content, and
/// scene.yaml, which names it, is renamed into place: a bundle is always wholly before an edit
/// or wholly after it. With everything undone it is byte for byte what it was.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/bundle_parts.h"
#include "core/scene_bundle.h"
#include "experiments/scene_labels/edit_journal.h"
#include "experiments/scene_labels/label_operations.h"
#include "experiments/scene_labels/label_state.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/support/folder_lock.h"

namespace segsim::experiments::scene_labels {

class LabelEditor {
 public:
  /// Opens a bundle for this object alone. An edit that a crash left in the journal only is
  /// brought into the bundle.
  /// @throws core::InputError: no bundle, surfels without labels, a damaged journal or one of
  ///     another scene, labels that the journal does not lead to, another editor at work.
  explicit LabelEditor(const std::filesystem::path& folder);

  [[nodiscard]] const core::SceneBundle& bundle() const { return bundle_; }
  [[nodiscard]] const core::BundleParts& parts() const { return parts_; }
  [[nodiscard]] const LabelState& state() const { return *state_; }
  /// As they were made: places and sizes; ids without the edits.
  [[nodiscard]] const renderer::SurfelCloud& cloud() const { return *unedited_.surfels; }
  /// With the labels that are in effect.
  [[nodiscard]] scenes::SceneSurfels surfels() const;
  /// Edits that are in effect.
  [[nodiscard]] std::size_t edit_count() const { return applied_; }
  /// Grows with every change of labels.
  [[nodiscard]] std::uint64_t revision() const { return revision_; }
  /// What undo() would take back, in words; nullopt: nothing.
  [[nodiscard]] std::optional<std::string> undoable() const;
  [[nodiscard]] std::optional<std::string> redoable() const;

  /// Does an edit that was made of state(). What was undone before cannot be redone any more.
  /// @return  What was done, in words.
  /// @throws core::InputError if journal or bundle cannot be written.
  std::string apply(const LabelEdit& edit);
  /// @throws core::InputError also if there is nothing to undo, or redo.
  std::string undo();
  std::string redo();

 private:
  [[nodiscard]] JournalStart start_of_bundle() const;
  [[nodiscard]] LabelState state_after(std::size_t edits) const;
  [[nodiscard]] bool bundle_has(const LabelState& state) const;
  std::string record(const JournalRecord& record);
  void refresh_bundle();
  void save();

  std::filesystem::path folder_;
  support::FolderLock lock_;
  core::SceneBundle bundle_;
  core::BundleParts parts_;
  scenes::SceneSurfels unedited_;
  std::optional<EditJournal> journal_;
  std::vector<LabelEdit> history_;  ///< Done and undone, oldest first.
  std::size_t applied_ = 0;         ///< Of the history, from the front.
  std::optional<LabelState> state_;
  std::uint64_t revision_ = 1;
  bool saved_ = true;  ///< False: the bundle could not be written.
};

}  // namespace segsim::experiments::scene_labels
