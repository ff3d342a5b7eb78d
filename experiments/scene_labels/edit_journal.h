#pragma once

/// @file
/// Everything that was done to the labels of a bundle, in the order in which it was done: one
/// line for each edit, undo and redo. It is written before the bundle is, and only ever grows,
/// so that nothing is lost: an edit that was undone and overtaken stays readable.
///
///     CHECKSUM {"schema":"segsim.label_journal","version":1,"surfels":...}
///
///     CHECKSUM {"edit":{"what":...,"set":[...],"moves":[...],...}}
///
///     CHECKSUM {"undo":"what"}   or "redo"
///
/// CHECKSUM: the first 16 hexadecimal digits of the SHA-256 of the checksum of the line above
/// (nothing above the first), a space and the JSON. So a line that is missing shows, too.

#include <filesystem>
#include <string>
#include <vector>

#include "core/scene_bundle.h"
#include "experiments/scene_labels/label_state.h"

namespace segsim::experiments::scene_labels {

inline constexpr const char* kJournalFileName = "label_journal.jsonl";

/// What the edits build on.
struct JournalStart {
  std::size_t surfels = 0;
  std::string surfels_sha256;
  std::string labels_sha256;  ///< Of label distributions; empty without.
  std::vector<core::SceneClass> classes;
  std::vector<core::SceneInstance> instances;
  renderer::LabelEdits edits;  ///< Set by hand before this journal began.
};

struct JournalRecord {
  enum class Kind : unsigned char { kEdit, kUndo, kRedo };
  Kind kind = Kind::kEdit;
  LabelEdit edit;  ///< Of undo and redo, its `what` alone.
};

class EditJournal {
 public:
  /// Reads the journal if there is one; begins it with the first append() if not. A last line
  /// without an end was never promised to anybody: it is left out, and gone with the next
  /// append().
  /// @param start  Of a journal that begins; also whose surfels an existing one must be about.
  /// @throws core::InputError with file and line for a damaged journal, or one of other
  ///     surfels.
  EditJournal(std::filesystem::path file, const JournalStart& start);

  [[nodiscard]] const JournalStart& start() const { return start_; }
  /// As read and appended.
  [[nodiscard]] const std::vector<JournalRecord>& records() const { return records_; }

  /// On the disk when it returns.
  /// @throws core::InputError if it cannot be written; the journal is then as before.
  void append(JournalRecord record);

 private:
  void read();
  [[nodiscard]] std::string line_of(const std::string& json);

  std::filesystem::path file_;
  JournalStart start_;
  std::vector<JournalRecord> records_;
  std::string checksum_;           ///< Of the last line.
  std::uintmax_t good_bytes_ = 0;  ///< Whole lines.
};

}  // namespace segsim::experiments::scene_labels
