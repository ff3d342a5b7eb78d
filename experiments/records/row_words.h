#pragma once

/// @file
/// The members of rows that are stored as words: enums, and optional ones, whose word for none
/// is "". In the program a row has the values; files and databases have the words.

#include <concepts>
#include <optional>
#include <string>
#include <string_view>

#include "core/stop_reason.h"
#include "experiments/records/failure_cause.h"
#include "experiments/records/trial_outcome.h"

namespace segsim::experiments::records {

template <class T>
concept StoredAsWord = std::same_as<T, TrialOutcome> ||
    std::same_as<T, std::optional<core::StopReason>> || std::same_as<T, std::optional<Cause>>;

[[nodiscard]] const char* word_of(TrialOutcome outcome);
[[nodiscard]] const char* word_of(const std::optional<core::StopReason>& reason);
[[nodiscard]] const char* word_of(const std::optional<Cause>& cause);

/// What word_of() gave.
/// @param place  Where the word was read, for the error message.
/// @throws core::InputError for another word.
void read_word(std::string_view word, const std::string& place, TrialOutcome& outcome);
void read_word(std::string_view word, const std::string& place,
               std::optional<core::StopReason>& reason);
void read_word(std::string_view word, const std::string& place, std::optional<Cause>& cause);

}  // namespace segsim::experiments::records
