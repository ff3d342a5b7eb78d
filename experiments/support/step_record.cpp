#include "experiments/support/step_record.h"

#include <ostream>
#include <utility>

#include "core/file_io.h"
#include "core/process/kernel_choice.h"

namespace segsim::experiments::support {

StepRecord::StepRecord(std::filesystem::path file, std::string recipe)
    : file_(std::move(file)), recipe_(std::move(recipe)) {
  if (core::kernel_choice() == core::KernelChoice::kFast) recipe_ += ", fast kernels";
}

bool StepRecord::is_current() const {
  return std::filesystem::exists(file_) && core::read_file(file_) == recipe_ + "\n";
}

void StepRecord::mark_done() const {
  core::write_file_atomically(file_, [&](std::ostream& out) { out << recipe_ << '\n'; });
}

std::string StepRecord::recipe_sha256() const { return core::sha256_hex(recipe_); }

}  // namespace segsim::experiments::support
