#pragma once

/// @file
/// What stages took, against their deadlines: as text and as a verdict.

#include <string>
#include <vector>

#include "experiments/results/statistics.h"
#include "sim/time/timing.h"

namespace segsim::experiments::results {

/// One deadline and how often it was missed.
struct DeadlineCheck {
  std::string stage;  ///< Or "end_to_end".
  double deadline_ms = 0.0;
  Proportion misses;
  Interval interval;  ///< Wilson's, of the miss rate.
  int longest_run = 0;
  bool holds = false;
};

/// Every deadline of the report. It holds if the upper end of the interval of its miss rate
/// does not exceed the limit; one that was never met nor missed does not hold.
[[nodiscard]] std::vector<DeadlineCheck> check_deadlines(const sim::TimingReport& timing,
                                                         double max_miss_rate,
                                                         double confidence = 0.95);

/// A table of the stages, the age of the images in use, and the load of the resources.
[[nodiscard]] std::string format_timing(const sim::TimingReport& timing);

/// One line per deadline.
[[nodiscard]] std::string format_checks(const std::vector<DeadlineCheck>& checks,
                                        double max_miss_rate, double confidence = 0.95);

/// {"stages": [...], "end_to_end": {...}, "age_ms": {...}, "utilisation": {...}}
[[nodiscard]] std::string timing_json(const sim::TimingReport& timing);

}  // namespace segsim::experiments::results
