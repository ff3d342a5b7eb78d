#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>

#include <gtest/gtest.h>
#include <unistd.h>

namespace segsim::tests {

/// An empty folder, removed in the end. Its name has the process and a number, so that tests
/// that run at the same time, or ask twice, do not meet.
class TemporaryFolder {
 public:
  /// Named by the test that runs.
  TemporaryFolder() : TemporaryFolder(name_of_test()) {}
  /// @param name  Its last part starts so: some readers look at it.
  explicit TemporaryFolder(const std::string& name)
      : path_(std::filesystem::temp_directory_path() / ("segsim_" + name + "_" + number())) {
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] std::filesystem::path operator/(const std::string& name) const {
    return path_ / name;
  }

  /// @param name  Below the folder; folders on the way are made.
  void write(const std::string& name, const std::string& text) const {
    const std::filesystem::path file = path_ / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary) << text;
  }

 private:
  static std::string name_of_test() {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    return std::string(test->test_suite_name()) + "_" + test->name();
  }
  static std::string number() {
    static int count = 0;
    return std::to_string(++count) + "_" + std::to_string(::getpid());
  }

  std::filesystem::path path_;
};

}  // namespace segsim::tests
