#pragma once

/// @file
/// A run told in 60 to 90 seconds: the question, pairs of trials before and after, the rates
/// with their intervals and their test.

#include <string>
#include <vector>

#include "experiments/films/run_video.h"
#include "experiments/results/table.h"

namespace segsim::experiments::films {

/// Two trials of one episode, and why these.
struct DemoPair {
  const records::TrialRow* before = nullptr;
  const records::TrialRow* after = nullptr;
  std::string reason;  ///< "one of 22 episodes in which only after succeeded"
};

/// Two episodes that only "after" solved (of different scenes if there are), then one that
/// does not speak for it: solved by "before" only, or else by neither. Of each group the
/// episode is taken whose longer trial is of median length, so that nobody chooses.
/// @param trials  Borrowed by the result.
[[nodiscard]] std::vector<DemoPair> choose_demo_pairs(
    const std::vector<records::TrialRow>& trials, const std::string& before,
    const std::string& after);

struct DemoOptions {
  VideoOptions video;         ///< Its speed is the least: long trials are shown faster.
  std::string before, after;  ///< Arms; empty: as tables choose them.
};

/// @throws core::InputError if the run has no two arms to compare, and as write_pair_video().
VideoSummary write_demo_video(const results::StoredRun& stored, const DemoOptions& options);

}  // namespace segsim::experiments::films
