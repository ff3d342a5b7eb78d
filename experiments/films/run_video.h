#pragma once

/// @file
/// Videos of a run's trials, made after the run. What the run recorded is played again with
/// the detections of its log (timing/replay_log.h) and drawn on the way: the same images and
/// the same decisions, checked tick by tick.

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "experiments/results/stored_run.h"
#include "experiments/specs/spec.h"
#include "experiments/trials/trial_viewer.h"

namespace segsim::experiments::films {

struct VideoOptions {
  std::filesystem::path output;  ///< The file; MP4 by its ending.
  std::filesystem::path data;    ///< Folder that ${data} in the spec stands for.
  double speed = 2.0;            ///< Simulated over shown time.
};

struct VideoSummary {
  int frames = 0;
  double duration_s = 0.0;
  /// The run's own recording was copied, because it left no log to play.
  bool copied = false;
};

/// Plays trials of one run.
class TrialPlayer {
 public:
  /// @param stored  Must outlive the player. @param data  See VideoOptions.
  TrialPlayer(const results::StoredRun& stored, std::filesystem::path data);
  ~TrialPlayer();
  TrialPlayer(const TrialPlayer&) = delete;
  TrialPlayer& operator=(const TrialPlayer&) = delete;

  /// @throws core::InputError if the trial left no log, or if it does not happen again as it
  /// did: a video would show something else than what was counted.
  void play(const records::TrialRow& trial, trials::TrialViewer& viewer);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// One trial: camera with detections, labels, map, figures; the outcome in the end.
/// @throws core::InputError as TrialPlayer::play(), if nothing was recorded either, and if the
/// file cannot be written.
VideoSummary write_trial_video(const results::StoredRun& stored,
                               const records::TrialRow& trial, const VideoOptions& options);

/// Two trials of one episode side by side, at the same simulated time.
VideoSummary write_pair_video(const results::StoredRun& stored, const records::TrialRow& left,
                              const records::TrialRow& right, const VideoOptions& options);

}  // namespace segsim::experiments::films
