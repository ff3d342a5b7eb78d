#pragma once

/// @file
/// Files that every report holds, from experiments/report/.

namespace segsim::experiments::report::internal {

extern const char* const kReportCss;
extern const char* const kReportJs;
/// Chart.js as the machine that built this program has it installed; empty if it has not.
extern const char* const kChartLibrary;

}  // namespace segsim::experiments::report::internal
