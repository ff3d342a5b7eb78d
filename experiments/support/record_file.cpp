#include "experiments/support/record_file.h"

#include <ostream>

#include "core/file_io.h"

namespace segsim::experiments::support {

void save_record(const std::filesystem::path& file, const core::MeasurementRecord& record) {
  if (file.empty()) return;
  core::write_file_atomically(file,
                              [&](std::ostream& out) { out << core::record_text(record); });
}

}  // namespace segsim::experiments::support
