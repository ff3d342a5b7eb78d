#include "core/stop_reason.h"

#include "core/name_table.h"

namespace segsim::core {
namespace {

constexpr NameTable<StopReason, StopReason::kStepFailed> kNames(
    "a stop reason",
    {"goal_reached", "no_frontier_left", "nothing_new", "stuck", "map_exhausted",
     "pointnav_stop", "no_path", "random_stop", "script_end", "step_failed"});

}  // namespace

const char* to_string(StopReason reason) { return kNames.name(reason); }

const char* to_string(const std::optional<StopReason>& reason) {
  return reason ? to_string(*reason) : "";
}

std::optional<StopReason> stop_reason_from(std::string_view name, const std::string& place) {
  if (name.empty()) return std::nullopt;
  return kNames.read(name, place);
}

}  // namespace segsim::core
