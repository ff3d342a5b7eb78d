#pragma once

/// @file
/// Why a policy declares an episode finished. Whether it was right is another question
/// (sim/trial/trial.h, experiments/records/failure_cause.h).

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace segsim::core {

enum class StopReason : std::uint8_t {
  kGoalReached,     ///< The only one with which an episode can succeed.
  kNoFrontierLeft,  ///< Everything that can be reached was explored.
  kNothingNew,      ///< It keeps exploring, and learns nothing.
  kStuck,           ///< Recovering was tried as often as it is allowed.
  kMapExhausted,    ///< The robot came to the edge of the largest map.
  kPointnavStop,    ///< The local policy stopped while it explored.
  kNoPath,          ///< There is no way to the place that was asked for.
  kRandomStop,
  kScriptEnd,   ///< Every action or step was done.
  kStepFailed,  ///< A step of a script was not done.
};

/// The name in files: "goal_reached", ...
[[nodiscard]] const char* to_string(StopReason reason);
/// The same; "" for none.
[[nodiscard]] const char* to_string(const std::optional<StopReason>& reason);

/// What to_string() gave, none for "".
/// @param place  Where the name was read, for the error message.
/// @throws InputError for another name.
[[nodiscard]] std::optional<StopReason> stop_reason_from(std::string_view name,
                                                         const std::string& place);

}  // namespace segsim::core
