#include "experiments/records/row_words.h"

namespace segsim::experiments::records {

const char* word_of(TrialOutcome outcome) { return to_string(outcome); }
const char* word_of(const std::optional<core::StopReason>& reason) {
  return core::to_string(reason);
}
const char* word_of(const std::optional<Cause>& cause) {
  return cause ? to_string(*cause) : "";
}

void read_word(std::string_view word, const std::string& place, TrialOutcome& outcome) {
  outcome = trial_outcome_from(word, place);
}
void read_word(std::string_view word, const std::string& place,
               std::optional<core::StopReason>& reason) {
  reason = core::stop_reason_from(word, place);
}
void read_word(std::string_view word, const std::string& place, std::optional<Cause>& cause) {
  cause = word.empty() ? std::nullopt : std::optional(cause_from(word, place));
}

}  // namespace segsim::experiments::records
