#include "experiments/results/training_statistics.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>
#include <vector>

#include "core/check.h"

namespace segsim::experiments::results {
namespace {

/// Mean of `weight` values of one column (training, or reconstruction) and one row (episode,
/// or scene) of the crossed design. Rows are compared within their stratum. All numbers count
/// from 0 without gaps.
struct Cell {
  int row = 0, column = 0, stratum = 0;
  double value = 0.0, weight = 1.0;
};

/// The values as cells of trainings x episodes, a stratum for each scene, sorted by row.
struct Design {
  std::vector<Cell> cells;
  std::vector<int> reconstruction;  ///< Of each column.
  int rows = 0, scenes = 0;

  [[nodiscard]] int columns() const { return static_cast<int>(reconstruction.size()); }
  [[nodiscard]] bool draws_scenes() const {
    return scenes >= static_cast<int>(kScenesForClaim);
  }
};

/// Episodes are compared with all others, not with those of their scene.
void join_scenes(Design& design) {
  for (Cell& cell : design.cells) cell.stratum = 0;
  design.scenes = std::min(design.scenes, 1);
}

std::pair<int, int> training_of(const SeededValue& v) {
  return {v.reconstruction, v.training};
}

bool same_episode(const SeededValue& a, const SeededValue& b) {
  return a.scene == b.scene && a.episode == b.episode;
}

std::vector<std::pair<int, int>> sorted_trainings(std::span<const SeededValue> values) {
  std::vector<std::pair<int, int>> trainings;  // Few, so that they are kept sorted.
  for (const SeededValue& v : values) {
    const auto at = std::lower_bound(trainings.begin(), trainings.end(), training_of(v));
    if (at == trainings.end() || *at != training_of(v)) trainings.insert(at, training_of(v));
  }
  return trainings;
}

/// By scene, episode, reconstruction, training.
std::vector<SeededValue> sorted_values(std::span<const SeededValue> values) {
  const auto place = [](const SeededValue& v) {
    return std::tie(v.scene, v.episode, v.reconstruction, v.training);
  };
  std::vector<SeededValue> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end(),
            [&](const SeededValue& a, const SeededValue& b) { return place(a) < place(b); });
  for (std::size_t k = 1; k < sorted.size(); ++k) {
    SEGSIM_CHECK(place(sorted[k - 1]) < place(sorted[k]),
                 "episode " + std::to_string(sorted[k].episode) + " has two values");
  }
  return sorted;
}

enum class Episodes { kAll, kComplete };  ///< Complete: with a value under every training.

Design crossed_design(std::span<const SeededValue> values, Episodes episodes) {
  const std::vector<std::pair<int, int>> trainings = sorted_trainings(values);
  const std::vector<SeededValue> sorted = sorted_values(values);
  Design design;
  design.cells.reserve(sorted.size());
  for (std::size_t k = 0; k < trainings.size(); ++k) {
    const bool next = k > 0 && trainings[k].first != trainings[k - 1].first;
    design.reconstruction.push_back(k == 0 ? 0
                                           : design.reconstruction.back() + (next ? 1 : 0));
  }
  const SeededValue* last = nullptr;
  for (std::size_t begin = 0, end = 0; begin < sorted.size(); begin = end) {
    while (end < sorted.size() && same_episode(sorted[begin], sorted[end])) ++end;
    if (episodes == Episodes::kComplete && end - begin < trainings.size()) continue;
    design.scenes += last == nullptr || last->scene != sorted[begin].scene ? 1 : 0;
    last = &sorted[begin];
    for (std::size_t k = begin; k < end; ++k) {
      const auto column =
          std::lower_bound(trainings.begin(), trainings.end(), training_of(sorted[k]));
      design.cells.push_back({design.rows, static_cast<int>(column - trainings.begin()),
                              design.scenes - 1, sorted[k].value});
    }
    ++design.rows;
  }
  // Of one episode each, scenes are what is drawn.
  if (design.rows == design.scenes) join_scenes(design);
  return design;
}

/// Cells of the same row and column become one.
std::vector<Cell> merged(std::vector<Cell> cells) {
  std::stable_sort(cells.begin(), cells.end(), [](const Cell& a, const Cell& b) {
    return std::tie(a.row, a.column) < std::tie(b.row, b.column);
  });
  std::vector<Cell> out;
  for (const Cell& cell : cells) {
    if (out.empty() || out.back().row != cell.row || out.back().column != cell.column) {
      out.push_back(cell);
      continue;
    }
    Cell& sum = out.back();
    sum.value += (cell.value - sum.value) * cell.weight / (sum.weight + cell.weight);
    sum.weight += cell.weight;
  }
  return out;
}

/// Mean squares of the two-way layout and their degrees of freedom; 0 with 0 degrees where
/// there is nothing to compare.
struct MeanSquares {
  double column = 0.0, row = 0.0, interaction = 0.0;
  double column_df = 0.0, row_df = 0.0;
  double mean = 0.0, weight = 0.0;
  double rounding = 0.0;  ///< Smaller mean squares are 0.
};

struct WeightedMean {
  double sum = 0.0, weight = 0.0;
  void add(const Cell& cell) {
    sum += cell.weight * cell.value;
    weight += cell.weight;
  }
  [[nodiscard]] double value() const { return sum / weight; }
};

/// Means of the cells by key(cell).
template <typename Key>
std::vector<WeightedMean> means_by(std::span<const Cell> cells, Key key) {
  std::vector<WeightedMean> means;
  for (const Cell& cell : cells) {
    const auto k = static_cast<std::size_t>(key(cell));
    if (k >= means.size()) means.resize(k + 1);
    means[k].add(cell);
  }
  return means;
}

double square(double x) { return x * x; }

MeanSquares mean_squares(std::span<const Cell> cells) {
  const auto all = means_by(cells, [](const Cell&) { return 0; });
  const auto column = means_by(cells, [](const Cell& c) { return c.column; });
  const auto row = means_by(cells, [](const Cell& c) { return c.row; });
  const auto stratum = means_by(cells, [](const Cell& c) { return c.stratum; });
  const auto columns = static_cast<int>(column.size());
  const auto block_of = [&](const Cell& c) { return c.stratum * columns + c.column; };
  const auto block = means_by(cells, block_of);
  const auto blocks = static_cast<double>(std::count_if(
      block.begin(), block.end(), [](const WeightedMean& m) { return m.weight > 0.0; }));

  MeanSquares squares{.mean = all.at(0).value(), .weight = all.at(0).weight};
  double columns_sum = 0.0, rows_sum = 0.0, rest_sum = 0.0;
  for (const WeightedMean& m : column) {
    columns_sum += m.weight * square(m.value() - squares.mean);
  }
  for (const Cell& c : cells) {
    const double row_mean = row[static_cast<std::size_t>(c.row)].value();
    const double stratum_mean = stratum[static_cast<std::size_t>(c.stratum)].value();
    const double block_mean = block[static_cast<std::size_t>(block_of(c))].value();
    squares.rounding += 1e-24 * c.weight * square(c.value);
    rows_sum += c.weight * square(row_mean - stratum_mean);
    rest_sum += c.weight * square(c.value - block_mean - row_mean + stratum_mean);
  }
  const auto rows = static_cast<double>(row.size());
  const auto strata = static_cast<double>(stratum.size());
  const double rest_df = static_cast<double>(cells.size()) - blocks - rows + strata;
  squares.column_df = columns - 1.0;
  squares.row_df = rows - strata;
  if (squares.column_df > 0.0) squares.column = columns_sum / squares.column_df;
  if (squares.row_df > 0.0) squares.row = rows_sum / squares.row_df;
  if (rest_df > 0.0) squares.interaction = rest_sum / rest_df;
  return squares;
}

/// The mean of a design, its variance over all that is drawn, and the degrees of freedom of
/// Student's t for it.
struct Estimate {
  double mean = 0.0, variance = 0.0, degrees_of_freedom = 0.0;
  double values = 0.0;
};

/// Columns become reconstructions if there are several, rows become scenes if those are drawn.
std::vector<Cell> drawn_cells(const Design& design) {
  std::vector<Cell> cells = design.cells;
  const bool several = design.reconstruction.back() > 0;
  for (Cell& cell : cells) {
    if (several) cell.column = design.reconstruction[static_cast<std::size_t>(cell.column)];
    if (design.draws_scenes()) cell.row = std::exchange(cell.stratum, 0);
  }
  return several || design.draws_scenes() ? merged(std::move(cells)) : cells;
}

/// @param share  Of the columns in the variance of the mean.
double degrees_of_freedom(const MeanSquares& squares, double share) {
  if (squares.row_df <= 0.0) return squares.column_df;
  if (squares.column_df <= 0.0) return squares.row_df;
  // Satterthwaite's formula with the share once, not squared: it rests on a few trainings, and
  // is too small just when the variance is.
  return 1.0 / (share / squares.column_df + square(1.0 - share) / squares.row_df);
}

/// @param more_variance  Added to the variance that comes from the rows.
Estimate estimate_mean(const Design& design, double more_variance = 0.0) {
  const MeanSquares squares = mean_squares(drawn_cells(design));
  // The interaction is in both mean squares, and counts once. A variance is not negative.
  const double rows =
      std::max(0.0, squares.row - squares.interaction) + more_variance * squares.weight;
  const double sum = squares.column + rows;
  if (sum <= squares.rounding) return {.mean = squares.mean, .values = squares.weight};
  Estimate estimate{
      .mean = squares.mean, .variance = sum / squares.weight, .values = squares.weight};
  estimate.degrees_of_freedom = degrees_of_freedom(squares, squares.column / sum);
  return estimate;
}

/// 2^(1 - n) for n episodes with any difference: what the sign test would give if all agreed.
double smallest_p(const Design& design) {
  int differing = 0, last = -1;
  for (const Cell& cell : design.cells) {
    if (cell.value == 0.0 || cell.row == last) continue;
    ++differing;
    last = cell.row;
  }
  return std::min(1.0, std::exp2(1 - differing));
}

double upper_quantile(double confidence) { return 0.5 + 0.5 * confidence; }

/// Whether the values can be differences of successes.
bool within_one(const Design& design) {
  return std::all_of(design.cells.begin(), design.cells.end(),
                     [](const Cell& c) { return std::abs(c.value) <= 1.0; });
}

/// Of values that differ nowhere: other episodes may, as many as Wilson's interval allows.
Interval interval_without_spread(const Design& design, double mean, double confidence) {
  if (!within_one(design)) return {mean, mean};
  const double others = wilson_interval({0, design.rows}, confidence).high;
  return {mean - others * (1.0 + mean), mean + others * (1.0 - mean)};
}

}  // namespace

MeanInterval hierarchical_interval(std::span<const SeededValue> differences,
                                   double confidence) {
  if (differences.empty()) return {};
  const Design design = crossed_design(differences, Episodes::kAll);
  const Estimate estimate = estimate_mean(design);
  const double mean = estimate.mean;
  if (estimate.variance == 0.0) {
    return {mean, interval_without_spread(design, mean, confidence)};
  }
  const double half =
      student_quantile(upper_quantile(confidence), estimate.degrees_of_freedom) *
      std::sqrt(estimate.variance);
  return {mean, {mean - half, mean + half}};
}

MeanInterval hierarchical_rate_interval(std::span<const SeededValue> successes,
                                        double confidence) {
  if (successes.empty()) return {0.0, {0.0, 1.0}};
  for (const SeededValue& v : successes) {
    SEGSIM_CHECK(v.value >= 0.0 && v.value <= 1.0, std::to_string(v.value));
  }
  Design design = crossed_design(successes, Episodes::kAll);
  if (!design.draws_scenes()) join_scenes(design);
  const Estimate estimate = estimate_mean(design);
  const double rate = std::clamp(estimate.mean, 0.0, 1.0);
  const double spread = rate * (1.0 - rate);
  const bool episodes_alone = design.columns() == 1 && !design.draws_scenes();
  if (episodes_alone || estimate.variance == 0.0 || spread == 0.0) {
    return {rate,
            score_interval(rate, design.rows, normal_quantile(upper_quantile(confidence)))};
  }
  return {rate, score_interval(rate, spread / estimate.variance,
                               student_quantile(upper_quantile(confidence),
                                                estimate.degrees_of_freedom))};
}

TrainingTest training_test(std::span<const SeededValue> differences) {
  const Design design = crossed_design(differences, Episodes::kComplete);
  TrainingTest test;
  if (design.rows == 0) return test;
  const MeanSquares squares = mean_squares(design.cells);
  const auto deviation = [&](double mean_square, double values) {
    return std::sqrt(std::max(0.0, mean_square - squares.interaction) / values);
  };
  test.training_sd = deviation(squares.column, design.rows);
  test.episode_sd = deviation(squares.row, design.columns());
  if (design.columns() == 1) return test;

  // Half an episode for either arm, as Agresti & Min (2005) add to each cell of the table, in
  // each run of "before": one that never failed in n episodes may yet fail, however many
  // trainings it is compared with.
  const double runs_of_before = design.reconstruction.back() + 1.0;
  const double halves =
      within_one(design) ? 1.0 / (square(design.rows) * runs_of_before) : 0.0;
  const Estimate estimate = estimate_mean(design, halves);
  test.degrees_of_freedom = estimate.degrees_of_freedom;
  const double p = estimate.variance > 0.0
                       ? student_two_sided_p(estimate.mean / std::sqrt(estimate.variance),
                                             estimate.degrees_of_freedom)
                       : (estimate.mean == 0.0 ? 1.0 : 0.0);
  test.p = std::max(p, smallest_p(design));
  return test;
}

}  // namespace segsim::experiments::results
