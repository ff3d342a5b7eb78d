#pragma once

/// @file
/// What a table says of trainings: how many there were, what each came to, and how much they
/// differ.

#include <string>
#include <vector>

#include "experiments/results/table.h"
#include "experiments/support/grid_document.h"

namespace segsim::experiments::results::internal {

/// d < 0.1 m, a tenth of what most rules ask for: a named rule.
inline constexpr const char* kStrictestRule = "habitat-hm3d";

/// "one training", "3 trainings", "6 trainings in 2 reconstructions"; empty if training is not
/// what is compared.
[[nodiscard]] std::string trainings_in_words(const ResultTable& table);

/// The title with those words.
[[nodiscard]] std::string headline_title(const ResultTable& table);
/// Below the headline: what the interval knows of training, the success rule by name, and the
/// rates by the strictest named rule.
[[nodiscard]] std::vector<std::string> headline_lines(const ResultTable& table);

/// The row of all scenes, or of the only one.
[[nodiscard]] const GroupSummary& headline_group(const ResultTable& table);

/// Sample standard deviation of the success rates of trainings, [0, 1]; 0 of one.
[[nodiscard]] double training_rate_sd(const std::vector<TrainingSummary>& trainings);

/// A row per training, with how much they differ below; no rows of one training.
[[nodiscard]] support::internal::Grid trainings_grid(const ResultTable& table);

}  // namespace segsim::experiments::results::internal
