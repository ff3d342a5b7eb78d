#pragma once

/// @file
/// What the sources of the store share: the open database, its statements and transactions.

#include <chrono>
#include <filesystem>
#include <map>
#include <memory>

#include <sqlite3.h>

#include "experiments/records/internal/sqlite_statement.h"
#include "experiments/records/store.h"

namespace segsim::experiments::records {

struct Store::Impl {
  using Clock = std::chrono::steady_clock;

  std::filesystem::path file;
  sqlite3* db = nullptr;
  /// Compiled once each: the cost of adding a trial is mostly that of compiling SQL. By
  /// address of the constant text.
  std::map<const char*, std::unique_ptr<Statement>> statements;
  std::optional<Clock::time_point> synced;  ///< What was added before is on the disk.

  ~Impl() {
    statements.clear();
    sqlite3_close(db);
  }

  void execute(const char* sql) const {
    if (sqlite3_exec(db, sql, nullptr, nullptr, nullptr) != SQLITE_OK) {
      throw sqlite_error(db, file);
    }
  }

  /// A statement that is used again and again, ready for its values.
  Statement& prepared(const char* sql) {
    std::unique_ptr<Statement>& statement = statements[sql];
    if (statement == nullptr) statement = std::make_unique<Statement>(db, file, sql);
    return statement->reset();
  }

  /// The first column of the first row; `fallback` if there is no row.
  [[nodiscard]] std::int64_t query_integer(const char* sql, std::int64_t fallback) const {
    Statement statement(db, file, sql);
    return statement.step() ? statement.integer() : fallback;
  }

  /// Rolls back unless `commit` was called.
  class Transaction {
   public:
    explicit Transaction(const Impl& impl) : impl_(impl) { impl.execute("BEGIN IMMEDIATE"); }
    ~Transaction() {
      if (!done_) sqlite3_exec(impl_.db, "ROLLBACK", nullptr, nullptr, nullptr);
    }
    Transaction(const Transaction&) = delete;
    Transaction& operator=(const Transaction&) = delete;
    void commit() {
      impl_.execute("COMMIT");
      done_ = true;
    }

   private:
    const Impl& impl_;
    bool done_ = false;
  };

  /// @throws core::InputError for a damaged file.
  void check_integrity() const;
  void create_or_check_schema() const;
  /// Within a transaction, in an empty file.
  void create_schema() const;
  /// Within a transaction.
  void migrate() const;
  /// Within a transaction.
  void put_provenance(std::int64_t run_id, const std::string& name, const std::string& value);
  void put_trial(std::int64_t run_id, const TrialRow& trial);
  /// Whether the next commit waits until everything is on the disk (write-ahead log of SQLite
  /// with synchronous = FULL) or leaves that to a later one (NORMAL): waiting takes
  /// milliseconds, as long as a short trial.
  void choose_durability();
};

}  // namespace segsim::experiments::records
