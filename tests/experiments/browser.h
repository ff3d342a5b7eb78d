#pragma once

/// @file
/// A page as a real browser has it after its scripts have run.

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "core/file_io.h"

namespace segsim::tests {

inline bool has_browser() { return std::system("command -v chromium >/dev/null 2>&1") == 0; }

struct Browsed {
  std::string dom, log;
};

/// @param scratch  Folder for the browser's profile and log.
/// @param budget_ms  Of the page's own clock, which runs as fast as its requests allow.
/// @param screenshot  File for a picture in place of the DOM; empty: none.
inline Browsed browse(const std::string& address, const std::filesystem::path& scratch,
                      int budget_ms = 10000, const std::filesystem::path& screenshot = {},
                      const std::string& size = "1400,1000") {
  const std::filesystem::path log = scratch / "browser.log";
  const std::string what =
      screenshot.empty() ? "--dump-dom" : "--screenshot='" + screenshot.string() + "'";
  const std::string command =
      "chromium --headless --no-sandbox --disable-gpu --disable-dev-shm-usage "
      "--hide-scrollbars --use-angle=swiftshader --enable-unsafe-swiftshader "
      "--user-data-dir='" +
      (scratch / "profile").string() +
      "' --enable-logging=stderr --virtual-time-budget=" + std::to_string(budget_ms) +
      " --window-size=" + size + " " + what + " '" + address + "' 2>'" + log.string() + "'";
  Browsed browsed;
  FILE* pipe = ::popen(command.c_str(), "r");
  std::array<char, 4096> buffer{};
  while (std::fgets(buffer.data(), buffer.size(), pipe) != nullptr)
    browsed.dom += buffer.data();
  ::pclose(pipe);
  browsed.log = core::read_file(log);
  return browsed;
}

}  // namespace segsim::tests
