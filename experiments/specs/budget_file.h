#pragma once

/// @file
/// Latency budgets and traces as files (docs/simulation.md has the schema). A budget:
///
///     schema: segsim.budget/1
///     id: example-edge
///     resources: {gpu: 1, cpu: 2}
///     stages:
///       capture: {ms: 33}
///       detect:  {on: gpu, dist: {lognormal: {p50: 28, p95: 41}}, deadline_ms: 60}
///       policy:  {on: cpu, ms: 4}
///     end_to_end: {deadline_ms: 150, on_miss: use_stale}
///     max_age_ms: {value: 400, on_exceed: zero_command}
///
/// A trace is CSV: "stage,index,duration_ns", one line per job.

#include <filesystem>
#include <optional>
#include <string>

#include "sim/time/latency_budget.h"

namespace segsim::experiments::specs {

inline constexpr const char* kBudgetSchema = "segsim.budget/1";

struct BudgetFile {
  sim::LatencyBudget budget;
  /// `max_miss_rate`: what `segsim budget check` demands of each deadline if no flag says.
  std::optional<double> max_miss_rate;
  std::string text, sha256;  ///< Of the file itself; traces it names are not in it.
};

/// @throws core::InputError with file, line and key; also for what LatencyBudget::problem()
/// finds.
[[nodiscard]] BudgetFile read_budget_file(const std::filesystem::path& file);
/// The same from memory; `origin` stands for the file in messages and for relative traces.
[[nodiscard]] BudgetFile parse_budget(const std::string& text,
                                      const std::filesystem::path& origin);

/// @throws core::InputError with file and line.
[[nodiscard]] sim::LatencyTrace read_trace_csv(const std::filesystem::path& file);
void write_trace_csv(const std::filesystem::path& file, const sim::LatencyTrace& trace);

}  // namespace segsim::experiments::specs
