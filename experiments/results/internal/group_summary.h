#pragma once

/// @file
/// Rates, intervals and tests of one group of episodes: a scene, a class, all.

#include <string>
#include <vector>

#include "experiments/results/internal/arm_families.h"
#include "experiments/results/internal/sorted_trials.h"
#include "experiments/results/table.h"

namespace segsim::experiments::results::internal {

/// What a table is made from.
struct TableInputs {
  const std::vector<records::ArmRow>& arms;
  SortedTrials trials;
  std::vector<Family> families;
  std::vector<RowPair> pairs;  ///< Of the compared arms.
};

[[nodiscard]] GroupSummary summarise_group(const TableInputs& inputs, const std::string& name,
                                           const std::string& title,
                                           const SortedTrials::Belongs& belongs);

/// Each training against what it is compared with, over all episodes.
[[nodiscard]] std::vector<TrainingSummary> summarise_trainings(const TableInputs& inputs);

}  // namespace segsim::experiments::results::internal
