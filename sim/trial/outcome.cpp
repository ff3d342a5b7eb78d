#include "sim/trial/outcome.h"

#include "core/name_table.h"

namespace segsim::sim {
namespace {

constexpr core::NameTable<Outcome, Outcome::kAborted> kNames(
    "an outcome",
    {"success", "stopped_far", "not_visible", "timeout", "gave_up", "collision", "aborted"});

}  // namespace

const char* to_string(Outcome outcome) { return kNames.name(outcome); }

Outcome outcome_from(std::string_view name, const std::string& place) {
  return kNames.read(name, place);
}

}  // namespace segsim::sim
