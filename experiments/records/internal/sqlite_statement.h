#pragma once

/// @file
/// SQLite's prepared statements for the sources of the store.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include <sqlite3.h>

#include "core/error.h"

namespace segsim::experiments::records {

/// What went wrong last.
[[nodiscard]] inline core::InputError sqlite_error(sqlite3* db,
                                                   const std::filesystem::path& file) {
  const char* expected = "a working SQLite database";
  switch (sqlite3_errcode(db)) {
    case SQLITE_FULL:
      expected = "room for results (those that are in are kept)";
      break;
    case SQLITE_READONLY:
    case SQLITE_CANTOPEN:  // Also of the files that SQLite keeps beside it.
      expected = "a database in a folder that can be written to (or a copy in another)";
      break;
    default:
      break;
  }
  return core::InputError::expected(file.string(), expected, sqlite3_errmsg(db));
}

/// A prepared statement; values are bound and read in order.
class Statement {
 public:
  Statement(sqlite3* db, const std::filesystem::path& file, const char* sql)
      : db_(db), file_(file) {
    check(sqlite3_prepare_v2(db, sql, -1, &statement_, nullptr));
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  /// Makes it ready for other values.
  Statement& reset() {
    sqlite3_reset(statement_);  // Repeats the code of the last step, which was checked.
    bound_ = read_ = 0;
    return *this;
  }

  Statement& bind(const std::string& text) {
    // SQLITE_TRANSIENT is a C cast; the text outlives the step, so no copy is needed.
    check(sqlite3_bind_text(statement_, ++bound_, text.c_str(), -1, nullptr));
    return *this;
  }
  Statement& bind(double value) {
    check(sqlite3_bind_double(statement_, ++bound_, value));
    return *this;
  }
  Statement& bind(std::int64_t value) {
    check(sqlite3_bind_int64(statement_, ++bound_, value));
    return *this;
  }
  Statement& bind(int value) { return bind(std::int64_t{value}); }
  Statement& bind(const std::optional<double>& value) {
    return value ? bind(*value) : bind_null();
  }
  Statement& bind_null() {
    check(sqlite3_bind_null(statement_, ++bound_));
    return *this;
  }

  /// @return  Whether there is a row to read.
  bool step() {
    read_ = 0;
    const int code = sqlite3_step(statement_);
    if (code != SQLITE_ROW && code != SQLITE_DONE) check(code);
    return code == SQLITE_ROW;
  }

  std::string text() { return std::string(text_view()); }
  /// Until the next step.
  std::string_view text_view() {
    const unsigned char* value = sqlite3_column_text(statement_, read_);
    const int bytes = sqlite3_column_bytes(statement_, read_++);
    return value == nullptr ? std::string_view()
                            : std::string_view(reinterpret_cast<const char*>(value),
                                               static_cast<std::size_t>(bytes));
  }
  double number() { return sqlite3_column_double(statement_, read_++); }
  std::int64_t integer() { return sqlite3_column_int64(statement_, read_++); }
  std::optional<double> optional_number() {
    if (skip_null()) return std::nullopt;
    return number();
  }
  /// Goes on to the next column if there is nothing in this one.
  bool skip_null() {
    const bool none = sqlite3_column_type(statement_, read_) == SQLITE_NULL;
    if (none) ++read_;
    return none;
  }

 private:
  void check(int code) const {
    if (code != SQLITE_OK) throw sqlite_error(db_, file_);
  }

  sqlite3* db_;
  const std::filesystem::path& file_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0, read_ = 0;
};

}  // namespace segsim::experiments::records
