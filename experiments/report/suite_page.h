#pragma once

/// @file
/// The results of a suite as one page and the files that others compare with.
///
///     index.html       the leaderboard, what carries over, all scenes, notes, hashes
///
///     episodes.csv     every trial (suites/episode_rows.h); episodes.jsonl: the same
///
///     manifest.json    suites/manifest.h

#include <filesystem>

#include "experiments/results/stored_run.h"

namespace segsim::experiments::report {

/// Files of an earlier page in the folder are replaced.
/// @return  The page.
std::filesystem::path write_suite_page(const results::StoredRun& stored,
                                       const std::filesystem::path& output);

}  // namespace segsim::experiments::report
