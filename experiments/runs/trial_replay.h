#pragma once

/// @file
/// Plays a recorded trial again (timing/replay_log.h): `segsim replay` compares the two,
/// `segsim video` looks at the second.

#include <filesystem>
#include <memory>

#include "experiments/records/replay_log.h"
#include "experiments/specs/spec.h"
#include "experiments/trials/trial_viewer.h"

namespace segsim::experiments::runs {

/// The work folder that a log lies in: what stands before replays/.
/// @throws core::InputError if it lies elsewhere.
[[nodiscard]] std::filesystem::path work_of_replay(const std::filesystem::path& log_file);

/// The experiment that logs belong to: one spec, its scenes as they are needed.
class TrialReplay {
 public:
  /// @param log  Any log of the experiment.
  /// @param from_log  Detections come from logs: no weights are needed.
  /// @throws core::InputError if the spec or what it needs cannot be read.
  TrialReplay(const records::ReplayLog& log, specs::SpecFolders folders, bool from_log);
  ~TrialReplay();
  TrialReplay(const TrialReplay&) = delete;
  TrialReplay& operator=(const TrialReplay&) = delete;

  /// Whether the log is of the same spec and work folder.
  [[nodiscard]] bool fits(const records::ReplayLog& log,
                          const std::filesystem::path& work) const;

  /// The trial again. Nothing is written to the work folder.
  /// @param file  Of the log: images that were kept beside it are used, but not for a viewer,
  /// who wants colours.
  /// @param viewer  May be null.
  /// @throws core::InputError if what it needs is not what it was.
  records::ReplayLog play(const records::ReplayLog& log, const std::filesystem::path& file,
                          trials::TrialViewer* viewer = nullptr);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::experiments::runs
