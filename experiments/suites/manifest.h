#pragma once

/// @file
/// What two machines compare to show that they ran the same suite: hashes of the suite, its
/// scenes, its episodes, all weights, and the results.

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "experiments/results/stored_run.h"

namespace segsim::experiments::suites {

struct Manifest {
  static constexpr const char* kSchema = "segsim.suite_manifest/1";

  std::string suite;
  /// What, in words, and its SHA-256, in the order of the run: "suite", "spec", "scene A",
  /// "episodes of A", "weights of B", "weights of B in A", "results" (once all are there).
  std::vector<std::pair<std::string, std::string>> hashes;
  int planned_trials = 0, finished_trials = 0;
  /// Not compared: "segsim", "kernels", "processor".
  std::vector<std::pair<std::string, std::string>> made_by;

  /// Empty if there is none.
  [[nodiscard]] std::string hash_of(const std::string& what) const;
};

[[nodiscard]] Manifest manifest_of(const results::StoredRun& stored);

void write_manifest(const std::filesystem::path& file, const Manifest& manifest);
/// @throws core::InputError for another file or a damaged one.
[[nodiscard]] Manifest read_manifest(const std::filesystem::path& file);

/// What differs between two manifests; what only one has is among it.
[[nodiscard]] std::vector<std::string> differences(const Manifest& a, const Manifest& b);

/// @param a, b  What messages call them.
/// @throws core::InputError, one line, if they differ.
void expect_same(const Manifest& expected, const std::string& a, const Manifest& found,
                 const std::string& b);

}  // namespace segsim::experiments::suites
