#include "experiments/runs/step_record.h"

#include <ostream>

#include "core/file_io.h"

namespace segsim::experiments {

bool StepRecord::is_current() const {
  return std::filesystem::exists(file_) && core::read_file(file_) == recipe_ + "\n";
}

void StepRecord::mark_done() const {
  core::write_file_atomically(file_, [&](std::ostream& out) { out << recipe_ << '\n'; });
}

std::string StepRecord::recipe_sha256() const { return core::sha256_hex(recipe_); }

}  // namespace segsim::experiments
