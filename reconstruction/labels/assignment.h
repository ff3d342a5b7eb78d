#pragma once

/// @file
/// Linear sum assignment: which rows take which columns so that the sum of costs is smallest
/// (paper, "Instance Query Alignment"). Shortest augmenting paths with dual variables, after
/// Jonker and Volgenant 1987, "A shortest augmenting path algorithm for dense and sparse
/// linear assignment problems": O(k^2 n) for k = min(rows, columns), n = the other.

#include <cstddef>
#include <span>
#include <vector>

namespace segsim::reconstruction {

inline constexpr int kUnassigned = -1;

/// @param cost  [rows, columns], finite.
/// @return  [rows], column of each row; kUnassigned for rows that are left over when there are
///     more rows than columns. Each column is taken once at most, and min(rows, columns) pairs
///     are made. Deterministic.
/// @throws core::ContractViolation for a cost that is not finite or another number of costs.
[[nodiscard]] std::vector<int> assign(std::span<const double> cost, std::size_t rows,
                                      std::size_t columns);

}  // namespace segsim::reconstruction
