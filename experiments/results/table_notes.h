#pragma once

/// @file
/// Part of table.cpp: what is said below a table.

#include <string>
#include <vector>

#include "experiments/results/table.h"

namespace segsim::experiments::results::internal {

/// Null if there is none.
[[nodiscard]] const records::ArmRow* find_arm(const std::vector<records::ArmRow>& arms,
                                              const std::string& name);

/// State of the run, what is in no rate, how to read the figures, leakage, provenance.
void add_notes(ResultTable& table, const std::vector<records::TrialRow>& trials);

}  // namespace segsim::experiments::results::internal
