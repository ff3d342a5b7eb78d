#pragma once

/// @file
/// The words in a row of the store that stand for values of enums: outcome, stop reason,
/// cause.

#include <string>

#include "experiments/records/store.h"

namespace segsim::experiments::records {

/// @param file  That the row was read from, for the error message.
/// @throws core::InputError that names file, trial, column and word, if the program does not
/// know the word.
void check_names(const TrialRow& row, const std::string& file);

}  // namespace segsim::experiments::records
