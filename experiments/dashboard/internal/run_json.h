#pragma once

/// @file
/// Runs as the JSON that the pages poll.

#include <string>

#include <nlohmann/json.hpp>

#include "experiments/dashboard/internal/live_files.h"
#include "experiments/dashboard/internal/run_index.h"

namespace segsim::experiments::dashboard::internal {

using Json = nlohmann::ordered_json;

/// Never throws for bytes that are no UTF-8: they become U+FFFD.
[[nodiscard]] std::string json_text(const Json& json);

/// Time left, and what is known about the pace.
struct Pace {
  double trials_per_s = 0.0;   ///< 0: not known.
  double since_last_s = -1.0;  ///< Since the newest trial; -1: none.
};
/// From finish times (newest first, UTC), leaving out what lies before a pause.
/// @param now  UTC, as the times.
[[nodiscard]] Pace pace_of(const std::vector<std::string>& finish_times,
                           const std::string& now);

/// Progress, state, rates with their intervals, the paired test.
[[nodiscard]] Json overview_json(const RunSnapshot& run, const std::vector<LiveFile>& live,
                                 const std::string& now);

/// Trials, newest first, from `offset` on.
[[nodiscard]] Json trials_json(const RunSnapshot& run, std::size_t offset, std::size_t count);

/// One row of that list.
[[nodiscard]] Json trial_json(const records::TrialRow& trial);

}  // namespace segsim::experiments::dashboard::internal
