#pragma once

/// @file
/// Rows as SQL: tables, statements and values, made from visit_columns (column.h).

#include <charconv>
#include <cmath>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>

#include "core/formatted.h"
#include "experiments/records/column.h"
#include "experiments/records/internal/sqlite_statement.h"
#include "experiments/records/row_words.h"

namespace segsim::experiments::records {

/// The table of the row, or `attribution`.
enum class SqlTable : std::uint8_t { kOfRow, kAttribution };

[[nodiscard]] constexpr SqlTable table_of(const Column& column) {
  return column.part == Part::kRow ? SqlTable::kOfRow : SqlTable::kAttribution;
}

[[nodiscard]] inline const char* sql_type(const Column& /*column*/,
                                          const std::string& /*text*/) {
  return "TEXT NOT NULL";
}
template <StoredAsWord W>
[[nodiscard]] const char* sql_type(const Column& /*column*/, const W& /*word*/) {
  return "TEXT NOT NULL";
}
[[nodiscard]] inline const char* sql_type(const Column& /*column*/, double /*number*/) {
  return "REAL NOT NULL";
}
[[nodiscard]] inline const char* sql_type(const Column& /*column*/,
                                          const std::optional<double>& /*number*/) {
  return "REAL";
}
template <std::integral Integer>
[[nodiscard]] const char* sql_type(const Column& column, Integer /*number*/) {
  if (column.given_by_store) return "INTEGER PRIMARY KEY";
  return column.hexadecimal ? "TEXT NOT NULL" : "INTEGER NOT NULL";
}

/// "arm TEXT NOT NULL, spl REAL NOT NULL": as CREATE TABLE wants them.
template <class Row>
[[nodiscard]] std::string column_definitions(SqlTable table = SqlTable::kOfRow) {
  std::string sql;
  const Row row;
  visit_columns(row, [&](const Column& column, const auto& value) {
    if (table_of(column) != table) return;
    if (!sql.empty()) sql += ", ";
    sql += std::string(column.name) + ' ' + sql_type(column, value);
  });
  return sql;
}

/// "SELECT spl, path_m": every column in the order of read_columns().
/// @param before  Columns that are read before read_columns() is called: "trial_id".
template <class Row>
[[nodiscard]] std::string select_columns(const std::string& before = {}) {
  std::string sql = before.empty() ? "" : "SELECT " + before;
  const Row row;
  visit_columns(row, [&](const Column& column, const auto& /*value*/) {
    sql += (sql.empty() ? "SELECT " : ", ") + std::string(column.name);
  });
  return sql;
}

/// "INSERT INTO trial (run_id, spl) VALUES (?, ?)".
/// @param keys  Columns that are bound before insert_row() is called: "run_id, position".
template <class Row>
[[nodiscard]] std::string insert_columns(const std::string& table_name,
                                         const std::string& keys,
                                         SqlTable table = SqlTable::kOfRow) {
  std::string names = keys, marks = keys.empty() ? "" : "?";
  for (const char c : keys) marks += c == ',' ? ", ?" : "";
  const Row row;
  visit_columns(row, [&](const Column& column, const auto& /*value*/) {
    if (table_of(column) != table || column.given_by_store) return;
    names += (names.empty() ? "" : ", ") + std::string(column.name);
    marks += marks.empty() ? "?" : ", ?";
  });
  return "INSERT INTO " + table_name + " (" + names + ") VALUES (" + marks + ")";
}

/// Binds a row's values to a statement, in the order of visit_columns. Lives until the
/// statement was stepped: it owns the texts that the row has as numbers or
/// enums.
class ColumnBinder {
 public:
  explicit ColumnBinder(Statement& statement) : statement_(statement) {}

  void operator()(const Column& /*column*/, const std::string& text) { statement_.bind(text); }
  template <StoredAsWord W>
  void operator()(const Column& /*column*/, const W& value) {
    statement_.bind(texts_.emplace_back(word_of(value)));
  }
  void operator()(const Column& /*column*/, double number) { statement_.bind(number); }
  /// A number that is not finite is none.
  void operator()(const Column& /*column*/, const std::optional<double>& number) {
    const bool is_one = number && std::isfinite(*number);
    statement_.bind(is_one ? number : std::nullopt);
  }
  template <std::integral Integer>
  void operator()(const Column& column, Integer number) {
    if (column.hexadecimal) {
      statement_.bind(texts_.emplace_back(core::hex(static_cast<std::uint64_t>(number))));
    } else {
      statement_.bind(static_cast<std::int64_t>(number));
    }
  }

 private:
  Statement& statement_;
  std::deque<std::string> texts_;
};

/// Steps a statement of insert_columns() whose keys are bound.
template <class Row>
void insert_row(Statement& insert, const Row& row, SqlTable table = SqlTable::kOfRow) {
  ColumnBinder bind(insert);
  visit_columns(row, [&](const Column& column, const auto& value) {
    if (table_of(column) == table && !column.given_by_store) bind(column, value);
  });
  insert.step();
}

inline void read_value(Statement& row, const Column& /*column*/, const std::string& /*place*/,
                       std::string& text) {
  text = row.text();
}
template <StoredAsWord W>
void read_value(Statement& row, const Column& column, const std::string& place, W& value) {
  read_word(row.text_view(), place + column.name, value);
}
inline void read_value(Statement& row, const Column& /*column*/, const std::string& /*place*/,
                       double& number) {
  number = row.number();
}
inline void read_value(Statement& row, const Column& /*column*/, const std::string& /*place*/,
                       std::optional<double>& number) {
  number = row.optional_number();
}
template <std::integral Integer>
void read_value(Statement& row, const Column& column, const std::string& /*place*/,
                Integer& number) {
  if (column.hexadecimal) {
    const std::string_view digits = row.text_view();
    std::uint64_t value = 0;
    std::from_chars(digits.data(), digits.data() + digits.size(), value, 16);
    number = static_cast<Integer>(value);
  } else {
    number = static_cast<Integer>(row.integer());
  }
}

/// The row that select_columns() stands at. What the table `attribution` does not know of it
/// keeps its default.
/// @param place  Of the row, for errors about words in it: "results.sqlite: trial 7: ".
/// @throws core::InputError that names place, column and word, if the program does not know
/// the word.
template <class Row>
[[nodiscard]] Row read_columns(Statement& select, const std::string& place = {}) {
  Row row;
  visit_columns(row, [&](const Column& column, auto& value) {
    if (table_of(column) == SqlTable::kAttribution && select.skip_null()) return;
    read_value(select, column, place, value);
  });
  return row;
}

}  // namespace segsim::experiments::records
