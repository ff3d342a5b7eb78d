#pragma once

/// @file
/// Benchmark results as records of results/.

#include <span>

#include "core/process/measurement_record.h"
#include "experiments/benchmarks/render_report.h"

namespace segsim::experiments::benchmarks {

/// A case for each result: frame times, frames per second, work at a pixel.
[[nodiscard]] core::MeasurementRecord bench_record(const BenchProvenance& provenance,
                                                   std::span<const BenchResult> results);

/// A case for each row, with the paper's figures where it has that row.
/// @param results  One for each row, in order.
[[nodiscard]] core::MeasurementRecord ablation_record(std::span<const AblationRow> rows,
                                                      std::span<const BenchResult> results);

}  // namespace segsim::experiments::benchmarks
