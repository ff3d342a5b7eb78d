#pragma once

/// @file
/// Is an episode set solvable? Every episode is checked in its world, then the oracle-path
/// arm, which is shown the shortest way, runs all of them: what it cannot solve no policy is
/// to blame for.

#include <filesystem>
#include <string>
#include <vector>

#include "core/scene_bundle.h"
#include "experiments/episodes/episode_check.h"
#include "experiments/episodes/episodes.h"
#include "experiments/records/store.h"
#include "sim/trial/success_profile.h"

namespace segsim::experiments::trials {

struct ValidationOptions {
  std::string robot;  ///< Empty: that of the set, else jackal-gentle.
  std::string profile = "segsim-object";
  episodes::EpisodeViewer viewer;  ///< For a set that names none.
  double control_period_s = 0.25, time_limit_s = 240.0;
  int workers = 1;
};

struct Validation {
  std::vector<episodes::EpisodeFinding> findings;  ///< One per episode.
  /// Of the episodes that can be done. Nothing was drawn far from the goal, so what they say
  /// of perception does not count.
  std::vector<records::TrialRow> trials;
  episodes::OracleRecord oracle;
  [[nodiscard]] bool flagged() const {
    return oracle.rate() < episodes::OracleRecord::kExpected;
  }
};

/// @param file  Of the set.
/// @throws core::InputError as read_episodes() and bind_episodes() do.
[[nodiscard]] Validation validate_episodes(const std::filesystem::path& file,
                                           const std::filesystem::path& bundle_folder,
                                           const ValidationOptions& options);

}  // namespace segsim::experiments::trials
