#pragma once

#include <filesystem>
#include <string>

#include <sqlite3.h>

namespace segsim::fuzz {

/// Runs statements on a database: no other files, and not for long. What fails is left out.
inline void run_limited_sql(const std::filesystem::path& file, const std::string& text) {
  sqlite3* database = nullptr;
  if (sqlite3_open(file.c_str(), &database) == SQLITE_OK) {
    sqlite3_exec(database, "PRAGMA synchronous = OFF; PRAGMA journal_mode = OFF", nullptr,
                 nullptr, nullptr);
    sqlite3_limit(database, SQLITE_LIMIT_ATTACHED, 0);
    sqlite3_limit(database, SQLITE_LIMIT_LENGTH, 1'000'000);
    sqlite3_limit(database, SQLITE_LIMIT_COMPOUND_SELECT, 3);
    sqlite3_set_authorizer(
        database,
        [](void*, int action, const char*, const char*, const char*, const char*) {
          return action == SQLITE_ATTACH || action == SQLITE_PRAGMA ? SQLITE_DENY : SQLITE_OK;
        },
        nullptr);
    sqlite3_progress_handler(
        database, 100'000, [](void*) { return 1; }, nullptr);
    sqlite3_exec(database, text.c_str(), nullptr, nullptr, nullptr);
  }
  sqlite3_close(database);
}

}  // namespace segsim::fuzz
