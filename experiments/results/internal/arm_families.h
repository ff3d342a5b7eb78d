#pragma once

/// @file
/// Which rows of a run's arms are one arm of the spec, and which are compared.

#include <cstddef>
#include <string>
#include <vector>

#include "experiments/records/store.h"
#include "experiments/results/table.h"

namespace segsim::experiments::results::internal {

/// Rows of the run's arms that are one arm of the spec, or one of them that was asked for.
struct Family {
  std::string name;
  std::vector<std::size_t> rows;
};

/// A row of one arm and the row that it is compared with, in the same reconstruction.
struct RowPair {
  std::size_t before, after;
  int reconstruction, training;  ///< As in SeededValue.
};

/// Arms of the spec, in the order of the run.
[[nodiscard]] std::vector<Family> arm_families(const std::vector<records::ArmRow>& arms);

/// nullptr if there is none of that name.
[[nodiscard]] const Family* find_family(const std::vector<Family>& families,
                                        const std::string& name);

/// Rows to compare, in each reconstruction: one with all of the other arm, or, of two arms
/// with several trainings, those of the same seed.
/// @throws core::InputError if they do not pair.
[[nodiscard]] std::vector<RowPair> paired_rows(const std::vector<records::ArmRow>& arms,
                                               const Family& before, const Family& after);

/// Fills in table.before, .after and .oracle.
/// @param before, after  Names that were asked for; empty: the first two that are no oracle.
/// @throws core::InputError if there is no such arm.
void choose_arms(const std::string& before, const std::string& after,
                 std::vector<Family>& families, ResultTable& table);

/// Whether different weights are compared: what their training drew is then part of chance.
[[nodiscard]] bool compares_weights(const std::vector<records::ArmRow>& arms,
                                    const std::vector<RowPair>& pairs);

}  // namespace segsim::experiments::results::internal
