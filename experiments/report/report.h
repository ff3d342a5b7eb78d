#pragma once

/// @file
/// A run as a folder of HTML that needs no network and no program: did it get better, how sure
/// are we, why did it fail; and below that every trial.
///
///     index.html           the answer, plots, tables, maps
///
///     trials.html          all trials; every number of the report links to those behind it
///
///     episodes/*.html      one episode: its arms side by side, stories, filmstrips
///
///     maps/ pictures/ strips/ videos/    what the pages show
///
/// Plots are drawn by Chart.js if the machine has it (libjs-chart.js); their figures stand
/// below them as a table in any case.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "experiments/results/stored_run.h"

namespace segsim::experiments::report {

struct ReportOptions {
  std::filesystem::path output;
  std::string before, after;  ///< Arms to compare; empty: as summarise().
  bool pictures = true;       ///< Filmstrips and maps; they need the scenes' bundles.
  int threads = 0;            ///< That draw them; 0: one per processor.
};

struct ReportSummary {
  std::filesystem::path index;
  int pages = 0, pictures = 0;
  std::uintmax_t bytes = 0;        ///< Of all files.
  std::vector<std::string> notes;  ///< What is missing and why; also in the report.
};

/// An earlier report in the folder is replaced.
/// @throws core::InputError if the folder holds other files, or for an unknown arm.
ReportSummary write_report(const results::StoredRun& stored, const ReportOptions& options);

}  // namespace segsim::experiments::report
