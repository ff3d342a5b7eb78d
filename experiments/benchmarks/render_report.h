#pragma once

/// @file
/// Benchmark results as a table, JSON and CSV; and the paper's Table 2 beside ours.

#include <span>
#include <string>
#include <vector>

#include "experiments/benchmarks/render_bench.h"
#include "experiments/results/table.h"

namespace segsim::experiments::benchmarks {

/// Where and with what numbers were measured.
struct BenchProvenance {
  std::string version, cpu, simd, date, scene;
  int views = 0, repeat = 0;
  std::vector<reproducibility::MachinePeaks>
      peaks;  ///< For 1 thread and for each thread count in use.

  /// The peaks for that many threads. @throws core::ContractViolation if not measured.
  [[nodiscard]] const reproducibility::MachinePeaks& peaks_for(int threads) const;
};

/// "rgb+depth".
[[nodiscard]] std::string channels_text(core::Channels channels);

/// Measures the machine for one thread and for every thread count in `cases`.
[[nodiscard]] BenchProvenance bench_provenance(const BenchScene& scene,
                                               std::span<const BenchCase> cases, int repeat);

[[nodiscard]] std::string bench_text(const BenchProvenance& provenance,
                                     std::span<const BenchResult> results);
[[nodiscard]] std::string bench_json(const BenchProvenance& provenance,
                                     std::span<const BenchResult> results);
[[nodiscard]] std::string bench_csv(const BenchProvenance& provenance,
                                    std::span<const BenchResult> results);

/// A row of the ablation: ours, and the paper's figures if it has that row.
struct AblationRow {
  std::string name, meaning;
  BenchCase setup;
  bool in_paper = false;
  double paper_ms = 0, paper_fps = 0, paper_rn_total = 0, paper_rn_tile = 0, paper_pq = 0;
};

/// (A) aabb + all, (S) snugbox + all, (B) accutile + all, (C) aabb + Top-K 3, (D) accutile +
/// Top-K 3 by weight, (C'), (D') with the first 3 that the ray meets; (E) is (D) with hidden
/// surfels skipped, and (E1) to (E24) are the same with other K.
/// @param base  Size, channels, threads, backend: a GPU has no rows with all surfels.
[[nodiscard]] std::vector<AblationRow> ablation_rows(const BenchCase& base);

/// @param results  One for each row, in order; agreement is with the first row.
[[nodiscard]] std::string ablation_table(const BenchProvenance& provenance,
                                         std::span<const AblationRow> rows,
                                         std::span<const BenchResult> results,
                                         support::TableFormat format);

}  // namespace segsim::experiments::benchmarks
