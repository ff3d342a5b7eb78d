#pragma once

/// @file
/// The words in a row of the store that stand for values of enums (outcome, stop reason,
/// cause), and for files.

#include <string>

#include "experiments/records/store.h"

namespace segsim::experiments::records {

/// @param file  That the row was read from, for the error message.
/// @throws core::InputError that names file, trial, column and word, if the program does not
/// know the word, or if a file does not lie below the folder of the run.
void check_names(const TrialRow& row, const std::string& file);

}  // namespace segsim::experiments::records
