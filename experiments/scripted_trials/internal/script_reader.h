#pragma once

/// @file
/// Parts of the reader of scripted trials.

#include <filesystem>
#include <string>
#include <vector>

#include "core/config.h"
#include "experiments/scripted_trials/scripted_trial.h"
#include "experiments/support/numbers_in_range.h"

namespace segsim::experiments::scripted_trials::script {

/// Where paths of a file lead to.
struct Reader {
  std::filesystem::path file;
  specs::SpecFolders folders;

  /// Relative to the file's folder; ${data} and ${spec} are replaced.
  [[nodiscard]] std::filesystem::path path(const core::ConfigNode& node) const;
};

/// @param latlon  The numbers are latitude and longitude [deg], not x and y [m].
[[nodiscard]] Place place_of(const core::ConfigNode& node, const std::vector<double>& numbers,
                             bool latlon);
/// `xy: [x, y]` or `latlon: [latitude, longitude]`.
[[nodiscard]] Place read_place(const core::ConfigNode& node);
[[nodiscard]] std::vector<ScriptStep> read_steps(const core::ConfigNode& root,
                                                 const Reader& reader);

}  // namespace segsim::experiments::scripted_trials::script
