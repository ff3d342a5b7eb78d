// CSV form of trial rows.
#include <cmath>
#include <concepts>
#include <cstdint>
#include <optional>
#include <string>

#include "core/formatted.h"
#include "experiments/records/row_words.h"
#include "experiments/records/store.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::records {
namespace {

std::string csv_value(const Column& /*column*/, const std::string& text) {
  return support::csv_cell(text);
}

template <StoredAsWord W>
std::string csv_value(const Column& /*column*/, const W& value) {
  return word_of(value);
}

std::string csv_value(const Column& /*column*/, double value) {
  return std::isfinite(value) ? core::print("%.6g", value) : "";
}

std::string csv_value(const Column& column, const std::optional<double>& value) {
  return value ? csv_value(column, *value) : "";
}

template <std::integral Integer>
std::string csv_value(const Column& column, Integer value) {
  if (column.hexadecimal) return core::hex(static_cast<std::uint64_t>(value));
  if (column.unknown_below_zero && static_cast<std::int64_t>(value) < 0) return "";
  return std::to_string(value);
}

/// Calls `f(column, value)` with a comma between two calls.
template <class F>
void write_line(std::ostream& out, const TrialRow& trial, const F& f) {
  const char* comma = "";
  visit_columns(trial, [&](const Column& column, const auto& value) {
    out << comma;
    comma = ",";
    f(column, value);
  });
  out << '\n';
}

}  // namespace

void write_trials_csv(std::ostream& out, const std::vector<TrialRow>& trials) {
  write_line(out, {}, [&](const Column& column, const auto&) { out << column.name; });
  for (const TrialRow& trial : trials) {
    write_line(out, trial, [&](const Column& column, const auto& value) {
      if (column.part != Part::kWhy || trial.why.known()) out << csv_value(column, value);
    });
  }
}

}  // namespace segsim::experiments::records
