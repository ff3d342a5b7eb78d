#pragma once

/// @file
/// Words of specs and of the command line for procedural homes.

#include <optional>
#include <string>

#include "experiments/specs/spec.h"

namespace segsim::experiments::specs {

/// "own", or a pool of the library's models: "train", "unseen", "all".
/// @param place  Named in messages: a flag, or file, line and key.
/// @throws core::InputError  anything else.
void parse_furniture(const std::string& text, const std::string& place, HomeSpec& home);

/// The folder whose libraries furnish the home: the named one, else Debian's if it is there;
/// none for own furniture.
[[nodiscard]] std::optional<std::filesystem::path> furniture_folder(const HomeSpec& home);

/// All that decides what stands in the home besides the seed, for the record of a capture:
/// ", plan office, 5 rooms, furniture train". Without the package it says so.
[[nodiscard]] std::string describe(const HomeSpec& home);

}  // namespace segsim::experiments::specs
