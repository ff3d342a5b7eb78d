#pragma once

/// @file
/// The parts of a table of results, and its figures as words: for `segsim table`, `segsim
/// compare`, the paper's Table 3 and the report.

#include <string>
#include <vector>

#include "experiments/results/table.h"
#include "experiments/support/grid_document.h"

namespace segsim::experiments::results::internal {

/// Whether two arms are compared.
[[nodiscard]] inline bool compares(const ResultTable& table) {
  return !table.before.empty() && !table.after.empty();
}

/// Name of the run's success rule, without its explanation.
[[nodiscard]] std::string profile_name(const ResultTable& table);
/// "0.012", or "2.1e-05".
[[nodiscard]] std::string p_text(double p);
/// "12/20  60 % [39, 78]", or "-" without an arm or trials; of several trainings
/// "35/60  58 % [40, 75]" with their interval.
[[nodiscard]] std::string rate_text(const ArmSummary* arm);
/// "+45 [+18, +64]", in points; "-" without pairs.
[[nodiscard]] std::string difference_text(const GroupSummary& group);
/// "+9 -0 of 20"
[[nodiscard]] std::string pairs_text(const GroupSummary& group);

/// A row per group: rates before and after, difference, pairs, p, verdict, oracle. @param
/// first Header of the first column. @param corrected  p after Holm's correction, no verdict.
[[nodiscard]] support::internal::Grid comparison_grid(const ResultTable& table,
                                                      const std::vector<GroupSummary>& groups,
                                                      const std::string& first,
                                                      bool corrected);
/// For runs without two arms to compare: a column per arm.
[[nodiscard]] support::internal::Grid rates_grid(const ResultTable& table,
                                                 const std::vector<GroupSummary>& groups,
                                                 const std::string& first);
/// A row per group and arm: SR, SPL, time, path, contacts, outcomes.
[[nodiscard]] support::internal::Grid arms_grid(const ResultTable& table,
                                                const std::vector<GroupSummary>& groups);
/// SPL, time and path, after - before; no rows without pairs.
[[nodiscard]] support::internal::Grid paired_grid(const ResultTable& table,
                                                  const std::vector<GroupSummary>& groups);
/// How good the arms' detectors are on held-out views; no rows if that was not measured.
[[nodiscard]] support::internal::Grid detectors_grid(const ResultTable& table);

/// All parts in their order.
[[nodiscard]] std::vector<support::internal::Grid> grids_of(const ResultTable& table);

}  // namespace segsim::experiments::results::internal
