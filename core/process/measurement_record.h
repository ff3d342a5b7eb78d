#pragma once

/// @file
/// What a benchmark measured, as a record of results/ (results/README.md has the format):
/// command, commit, day and machine are filled in here, so that every program tells them
/// alike.

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace segsim::core {

/// What a value is held to. Whether it is held is computed where records are read.
struct MeasurementGoal {
  enum class Kind { kAtMost, kAtLeast };
  Kind kind = Kind::kAtMost;
  double bar = 0.0;           ///< In the value's unit.
  std::optional<double> aim;  ///< Welcome beyond the bar.
};

struct MeasuredValue {
  std::string case_name;  ///< Row of the table; empty: the value is a row of its own.
  std::string name;       ///< "median"
  std::string unit;       ///< "ms", or empty.
  double value = 0.0;     ///< Finite.
  std::optional<MeasurementGoal> goal{};
  std::optional<std::pair<double, double>> interval95{};  ///< Low and high.
};

struct MeasurementRecord {
  std::string title;
  bool on_gpu = false;  ///< Whether the machine's GPU is named.
  std::vector<MeasuredValue> values;
};

/// JSON with one value a line. @throws ContractViolation without values, or for one that is
/// not finite.
[[nodiscard]] std::string record_text(const MeasurementRecord& record);

/// "Intel(R) Xeon(R) ...", or "unknown".
[[nodiscard]] std::string processor_name();

/// How this process was called, without folders before the program and without `--record
/// FILE`. Empty where the system does not tell.
[[nodiscard]] std::string command_line();

/// The same of given arguments. Quotes what a shell would take apart.
[[nodiscard]] std::string command_line(const std::vector<std::string>& arguments);

/// The hash in a version such as "0.1.0 (3f2c1ab-dirty)"; nothing for a build without git.
[[nodiscard]] std::optional<std::string> commit_of(const std::string& version);

}  // namespace segsim::core
