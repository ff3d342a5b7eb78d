#pragma once

/// @file
/// One run as it lies in a results database: what tables, comparisons and reports are made of.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "experiments/records/store.h"
#include "experiments/results/table.h"

namespace segsim::experiments::results {

struct StoredRun {
  std::filesystem::path folder;  ///< Of the database; files of trials are relative to it.
  records::RunRow run;
  std::vector<records::SceneRow> scenes;
  std::vector<records::ArmRow> arms;
  std::vector<records::TrialRow> trials;
};

/// @param work  Work folder of `segsim run`, or a results database.
/// @param run_id  Number of the run; 0: the last.
/// @throws core::InputError if there is no database or no such run.
[[nodiscard]] StoredRun load_run(const std::filesystem::path& work, std::int64_t run_id = 0);

/// summarise() of all of it.
[[nodiscard]] ResultTable summarise(const StoredRun& stored, const std::string& before = {},
                                    const std::string& after = {});

}  // namespace segsim::experiments::results
