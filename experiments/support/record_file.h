#pragma once

/// @file
/// `--record FILE` of commands that measure.

#include <filesystem>

#include "core/process/measurement_record.h"

namespace segsim::experiments::support {

inline constexpr const char* kRecordHelp = "Save a record for results/ (results/README.md)";

/// Writes the record atomically; nothing if no file is named.
void save_record(const std::filesystem::path& file, const core::MeasurementRecord& record);

}  // namespace segsim::experiments::support
