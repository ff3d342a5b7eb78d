#include "reconstruction/labels/assignment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "core/check.h"

namespace segsim::reconstruction {
namespace {

/// Rows <= columns. Rows enter one after another, each over the shortest path of reduced costs
/// to a free column; the path's pairs are then exchanged.
class Assignment {
 public:
  Assignment(std::span<const double> cost, std::size_t rows, std::size_t columns)
      : cost_(cost),
        columns_(columns),
        row_price_(rows, 0.0),
        column_price_(columns, 0.0),
        row_of_column_(columns, kUnassigned) {
    for (std::size_t row = 0; row < rows; ++row) insert(row);
  }

  [[nodiscard]] std::vector<int> columns_of_rows() const {
    std::vector<int> result(row_price_.size(), kUnassigned);
    for (std::size_t column = 0; column < columns_; ++column) {
      if (row_of_column_[column] == kUnassigned) continue;
      result[static_cast<std::size_t>(row_of_column_[column])] = static_cast<int>(column);
    }
    return result;
  }

 private:
  void insert(std::size_t first_row) {
    std::vector<double> distance(columns_, std::numeric_limits<double>::infinity());
    std::vector<int> previous(columns_, kUnassigned);  // Column before it on the path.
    std::vector<bool> settled(columns_, false);
    std::size_t row = first_row;
    int from = kUnassigned;
    double reached = 0.0;
    while (true) {
      std::size_t next = columns_;
      for (std::size_t column = 0; column < columns_; ++column) {
        if (settled[column]) continue;
        const double through =
            reached + cost_[row * columns_ + column] - row_price_[row] - column_price_[column];
        if (through < distance[column]) {
          distance[column] = through;
          previous[column] = from;
        }
        if (next == columns_ || distance[column] < distance[next]) next = column;
      }
      settled[next] = true;
      reached = distance[next];
      from = static_cast<int>(next);
      if (row_of_column_[next] == kUnassigned) break;
      row = static_cast<std::size_t>(row_of_column_[next]);
    }
    // Prices keep all reduced costs >= 0, and those of pairs at 0.
    row_price_[first_row] += reached;
    for (std::size_t column = 0; column < columns_; ++column) {
      if (!settled[column] || row_of_column_[column] == kUnassigned) continue;
      const double slack = reached - distance[column];
      row_price_[static_cast<std::size_t>(row_of_column_[column])] += slack;
      column_price_[column] -= slack;
    }
    for (int column = from; column != kUnassigned;) {
      const int before = previous[static_cast<std::size_t>(column)];
      row_of_column_[static_cast<std::size_t>(column)] =
          before == kUnassigned ? static_cast<int>(first_row)
                                : row_of_column_[static_cast<std::size_t>(before)];
      column = before;
    }
  }

  std::span<const double> cost_;
  std::size_t columns_;
  std::vector<double> row_price_, column_price_;
  std::vector<int> row_of_column_;
};

}  // namespace

std::vector<int> assign(std::span<const double> cost, std::size_t rows, std::size_t columns) {
  SEGSIM_CHECK(cost.size() == rows * columns, std::to_string(cost.size()) + " costs");
  SEGSIM_CHECK(
      std::all_of(cost.begin(), cost.end(), [](double c) { return std::isfinite(c); }),
      "a cost that is not finite");
  if (rows <= columns) return Assignment(cost, rows, columns).columns_of_rows();
  std::vector<double> transposed(cost.size());
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) transposed[c * rows + r] = cost[r * columns + c];
  }
  std::vector<int> result(rows, kUnassigned);
  const std::vector<int> row_of = Assignment(transposed, columns, rows).columns_of_rows();
  for (std::size_t c = 0; c < columns; ++c) {
    result[static_cast<std::size_t>(row_of[c])] = static_cast<int>(c);
  }
  return result;
}

}  // namespace segsim::reconstruction
