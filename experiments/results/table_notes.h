#pragma once

/// @file
/// Part of table.cpp: what is said below a table.

#include <string>
#include <vector>

#include "experiments/results/table.h"

namespace segsim::experiments::internal {

/// Null if there is none.
[[nodiscard]] const ArmRow* find_arm(const std::vector<ArmRow>& arms, const std::string& name);

/// State of the run, what is in no rate, how to read the figures, leakage, provenance.
void add_notes(ResultTable& table, const std::vector<TrialRow>& trials);

}  // namespace segsim::experiments::internal
