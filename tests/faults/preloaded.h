#pragma once

/// @file
/// Commands under the preloaded library of faults.

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "tests/faults/fault_report.h"

namespace segsim::tests {

/// A way in which calls fail.
struct Fault {
  const char* name;
  const char* calls;
  const char* error;
  bool lasting;
};
constexpr const char* kDiskCalls = "write,sync,rename,open,map";
constexpr Fault kFullDisk{"full disk", kDiskCalls, "ENOSPC", true};

/// What is counted in a process and its children.
class Report {
 public:
  explicit Report(const std::filesystem::path& file) {
    std::ofstream(file) << std::string(sizeof(FaultReport), '\0');
    const int descriptor = ::open(file.c_str(), O_RDWR | O_CLOEXEC);
    report_ = static_cast<FaultReport*>(::mmap(
        nullptr, sizeof(FaultReport), PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0));
    ::close(descriptor);
  }
  ~Report() { ::munmap(report_, sizeof(FaultReport)); }
  Report(const Report&) = delete;
  Report& operator=(const Report&) = delete;

  [[nodiscard]] std::uint64_t calls() const { return report_->calls; }
  [[nodiscard]] std::uint64_t failures() const { return report_->failures; }
  [[nodiscard]] std::string what() const { return report_->what; }

 private:
  FaultReport* report_;
};

/// What stands before a command so that its call with this number fails; 0: none does.
/// @param folder  Whose files count.
/// @param report  The file of a Report.
inline std::string with_fault(const Fault& fault, std::uint64_t at,
                              const std::filesystem::path& folder,
                              const std::filesystem::path& report) {
  return "env ASAN_OPTIONS=\"$ASAN_OPTIONS:verify_asan_link_order=0\" LD_PRELOAD='" +
         std::string(SEGSIM_FAULTS) + "' SEGSIM_FAULT_CALLS=" + fault.calls +
         " SEGSIM_FAULT_AT=" + std::to_string(at) + " SEGSIM_FAULT_ERROR=" + fault.error +
         (fault.lasting ? " SEGSIM_FAULT_LASTING=1" : "") + " SEGSIM_FAULT_FOLDER='" +
         folder.string() + "' SEGSIM_FAULT_PROGRAM=segsim-main SEGSIM_FAULT_REPORT='" +
         report.string() + "' ";
}

}  // namespace segsim::tests
