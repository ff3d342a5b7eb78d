#pragma once

/// @file
/// The paper's Table 3 ("Impact of finetuning": success rate before and after), with what its
/// own lacks: episodes, intervals, a paired test, the oracle, leakage.

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "experiments/results/table.h"

namespace segsim::experiments::results {

/// A row of the paper: Fast-SegSim (arXiv 2604.10951), table "Impact of finetuning". It names
/// neither the number of episodes nor the rule of success.
struct PaperNavigationRow {
  const char* scene;
  double before_percent, after_percent;
};
[[nodiscard]] std::span<const PaperNavigationRow> paper_table3();

/// One run; each of its scenes becomes a row.
struct NavigationEntry {
  std::string paper_scene;  ///< Of paper_table3(); empty: a scene that the paper has not.
  std::string title;        ///< Shown while there is no run.
  std::optional<ResultTable> result;
  std::string missing;  ///< Why there is none.
};

/// @throws core::ContractViolation for a scene that is not the paper's.
[[nodiscard]] std::string format_navigation_table(std::span<const NavigationEntry> entries,
                                                  support::TableFormat format);

}  // namespace segsim::experiments::results
