#pragma once

/// @file
/// Runs the executable as a user does.

#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace segsim::tests {

struct ProcessOutput {
  int exit_code = -1;
  std::string text;  ///< Standard output and error.
};

/// A line for the shell.
inline ProcessOutput run_shell(const std::string& line) {
  const std::string command = "{ " + line + "; } 2>&1";
  FILE* pipe = ::popen(command.c_str(), "r");
  ProcessOutput run;
  std::array<char, 4096> buffer{};
  while (std::fgets(buffer.data(), buffer.size(), pipe) != nullptr) run.text += buffer.data();
  run.exit_code = WEXITSTATUS(::pclose(pipe));
  return run;
}

inline ProcessOutput run_segsim(const std::string& arguments) {
  return run_shell(std::string(SEGSIM_BINARY) + " " + arguments);
}

/// Exit code 2 and one line with place, expected and found.
inline void expect_input_error(const ProcessOutput& run, const std::string& place) {
  EXPECT_EQ(run.exit_code, 2) << run.text;
  EXPECT_THAT(run.text, ::testing::HasSubstr(place));
  EXPECT_THAT(run.text, ::testing::HasSubstr(": expected "));
  EXPECT_THAT(run.text, ::testing::HasSubstr(", found "));
}

}  // namespace segsim::tests
