#pragma once

/// @file
/// How a trial ended.

#include <cstdint>
#include <string>
#include <string_view>

namespace segsim::sim {

enum class Outcome : std::uint8_t {
  kSuccess,     ///< Stopped near a goal that it sees.
  kStoppedFar,  ///< Stopped, but no goal view point is near.
  kNotVisible,  ///< Stopped near, but no goal instance is in view.
  kTimeout,
  kGaveUp,     ///< The policy stopped because nothing was left to explore.
  kCollision,  ///< Only with stop_on_contact.
  kAborted,    ///< A deadline or the age of an image, where the budget says "abort".
};

/// The name in files: "success", "stopped_far", ...
[[nodiscard]] const char* to_string(Outcome outcome);
/// @param place  Where the name was read, for the error message.
/// @throws core::InputError for a name that no outcome has.
[[nodiscard]] Outcome outcome_from(std::string_view name, const std::string& place);

}  // namespace segsim::sim
