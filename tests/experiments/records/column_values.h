#pragma once

/// @file
/// Rows for tests of what is made from their columns (experiments/records/column.h).

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

#include "core/formatted.h"
#include "experiments/records/column.h"
#include "experiments/records/row_words.h"

namespace segsim::experiments {

inline void set_value(const records::Column& column, int number, std::string& text) {
  text = column.name + std::string("#") + std::to_string(number);
}
/// One of the first seven values of an enum (all that are used have more), but not `present`.
template <class Enum>
[[nodiscard]] Enum another_value(int number, std::optional<Enum> present) {
  const int next = number % 6;
  const bool beyond = present && next >= static_cast<int>(*present);
  return static_cast<Enum>(next + (beyond ? 1 : 0));
}
/// An outcome of the simulator, so that the trial counts.
inline void set_value(const records::Column& /*column*/, int number,
                      records::TrialOutcome& outcome) {
  outcome = another_value<records::TrialOutcome>(number, outcome);
}
template <class Enum>
requires std::is_enum_v<Enum>
void set_value(const records::Column& /*column*/, int number, std::optional<Enum>& value) {
  value = another_value<Enum>(number, value);
}
inline void set_value(const records::Column& /*column*/, int number, double& value) {
  value = number + 0.1;
}
inline void set_value(const records::Column& /*column*/, int number,
                      std::optional<double>& value) {
  value = number + 0.3;
}
inline void set_value(const records::Column& /*column*/, int /*number*/, bool& value) {
  value = !value;
}
template <std::integral Integer>
void set_value(const records::Column& column, int number, Integer& value) {
  value = static_cast<Integer>(number);
  // Larger than SQLite's signed integers.
  if (column.hexadecimal) value = static_cast<Integer>(0xfedcba9800000000U + value);
}

/// A row with another value in each column, none of them its default.
template <class Row>
[[nodiscard]] Row with_distinct_values() {
  Row row;
  int number = 101;
  visit_columns(row, [&](const records::Column& column, auto& value) {
    set_value(column, number++, value);
  });
  return row;
}

inline std::string as_text(const std::string& text) { return text; }
template <records::StoredAsWord W>
std::string as_text(const W& word) {
  return records::word_of(word);
}
inline std::string as_text(double value) { return core::print("%a", value); }
inline std::string as_text(const std::optional<double>& value) {
  return value ? as_text(*value) : "none";
}
template <std::integral Integer>
std::string as_text(Integer value) {
  return std::to_string(value);
}

/// Name of each column -> its value, exactly.
template <class Row>
[[nodiscard]] std::map<std::string, std::string> values_of(const Row& row) {
  std::map<std::string, std::string> values;
  visit_columns(row, [&](const records::Column& column, const auto& value) {
    values[column.name] = as_text(value);
  });
  return values;
}

/// Stands for a member of any type.
struct AnyMember {
  template <class T>
  requires(!std::same_as<T, std::string_view>) operator T()
      const;  // NOLINT(google-explicit-constructor): that is what it is for.
};
/// How many members a row has, whether its columns are visited or not.
template <class Row, class... Members>
[[nodiscard]] consteval std::size_t count_members() {
  if constexpr (requires { Row{Members{}..., AnyMember{}}; }) {
    return count_members<Row, Members..., AnyMember>();
  } else {
    return sizeof...(Members);
  }
}

}  // namespace segsim::experiments
