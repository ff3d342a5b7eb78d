#pragma once

/// @file
/// Words of specs and of the command line for reading Gazebo worlds.

#include <string>

#include "experiments/specs/spec.h"

namespace segsim::experiments::specs {

/// "none", "walls", a height ("2.5") or a model and its height ("RoomCeiling_01@2.5").
/// @param place  Named in messages: a flag, or file, line and key.
/// @throws core::InputError  anything else, or a height that is not within 0.5 m and 100 m.
[[nodiscard]] worlds::CeilingOptions parse_ceiling(const std::string& text,
                                                   const std::string& place);

/// "error", "collision" or "skip". @throws core::InputError  anything else.
[[nodiscard]] worlds::OnMissing parse_on_missing(const std::string& text,
                                                 const std::string& place);

/// All that decides what is read of a world, for the record of a capture: ", ceiling walls".
[[nodiscard]] std::string describe(const GazeboSpec& spec);

}  // namespace segsim::experiments::specs
