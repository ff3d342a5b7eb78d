#pragma once

// Many cheap trials for tests of whole runs: two small rooms, images of a few pixels, an
// oracle detector, no pictures.

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <sqlite3.h>

#include "core/file_io.h"
#include "segsim_process.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"
#include "tests/temporary_folder.h"

namespace segsim::tests {

class ScaleOutFolder {
 public:
  /// @param trials  About so many, over two arms.
  explicit ScaleOutFolder(int trials) : repetitions_((trials + 3) / 4) {
    experiments::TinyScene().write(folder_.path() / "tiny");
    write_spec(3);
  }

  [[nodiscard]] const std::filesystem::path& path() const { return folder_.path(); }
  [[nodiscard]] int trials() const { return repetitions_ * 2 * 2; }
  [[nodiscard]] std::string quoted(const std::string& work) const {
    return "'" + (path() / work).string() + "'";
  }
  [[nodiscard]] std::vector<std::string> command(const std::string& work,
                                                 const std::string& flags) const {
    return {"/bin/sh", "-c", "exec " + std::string(SEGSIM_BINARY) + arguments(work, flags)};
  }
  [[nodiscard]] ProcessOutput segsim(const std::string& work, const std::string& flags = {},
                                     const std::string& first = {}) const {
    return run_shell(first + SEGSIM_BINARY + arguments(work, flags));
  }
  /// The part of the table that trials decide.
  [[nodiscard]] std::string table(const std::string& work) const {
    return core::read_file(path() / work / "table.csv");
  }
  /// Another text with the same meaning but for its seed.
  void change_spec() const { write_spec(4); }
  [[nodiscard]] std::string arguments(const std::string& work,
                                      const std::string& flags) const {
    return " run '" + (path() / "tiny.yaml").string() + "' --data '" + path().string() +
           "' --work " + quoted(work) + " " + flags;
  }

 private:
  void write_spec(int seed) const {
    const experiments::TinySpec spec{
        .goals = "couch, chair",
        .episodes = 2,
        .arms = R"(  - {name: before, detector: oracle}
  - {name: after, detector: oracle, policy: random}
)",
        .seed = seed,
        .control_period_s = 0.5,
        .time_limit_s = 8.0,
        .image_width_px = 32,
        .more = R"(success: {profile: segsim-object, distance_m: 1.0, visible_pixels: 10}
replays: {of: none}
pictures: false
repetitions: )" +
                std::to_string(repetitions_) + "\n"};
    folder_.write("tiny.yaml", spec.text());
  }

  TemporaryFolder folder_;
  int repetitions_;
};

/// The digest that `segsim run` and `segsim merge` print in the end.
inline std::string sha256_in(const std::string& text) {
  const std::size_t at = text.rfind("SHA-256");
  const std::size_t digits = text.find_first_of("0123456789abcdef", at + 8);
  for (std::size_t k = digits; k != std::string::npos && k + 64 <= text.size(); ++k) {
    if (text.substr(k, 64).find_first_not_of("0123456789abcdef") == std::string::npos) {
      return text.substr(k, 64);
    }
  }
  ADD_FAILURE() << "no digest in: " << text;
  return {};
}

/// What SQLite answers to a question with one number or word; "" if there is no database yet.
inline std::string answer_of(const std::filesystem::path& file, const char* question) {
  sqlite3* db = nullptr;
  std::string answer;
  if (sqlite3_open_v2(file.c_str(), &db, SQLITE_OPEN_READWRITE, nullptr) == SQLITE_OK) {
    const auto keep = [](void* to, int, char** columns, char**) {
      *static_cast<std::string*>(to) = columns[0];
      return 0;
    };
    sqlite3_exec(db, question, keep, &answer, nullptr);
  }
  sqlite3_close(db);
  return answer;
}

/// What SQLite's own check says of a database.
inline std::string integrity_of(const std::filesystem::path& file) {
  return answer_of(file, "PRAGMA integrity_check");
}

inline int trials_in(const std::filesystem::path& file) {
  return std::atoi(answer_of(file, "SELECT COUNT(*) FROM trial").c_str());
}

}  // namespace segsim::tests
