#pragma once

/// @file
/// Whether sources of a COLLADA file have the numbers that their accessors promise: assimp
/// reads them by index without a look at how many there are.

#include <string>
#include <string_view>

namespace segsim::worlds::internal {

/// Looks at arrays, accessors and the inputs of geometries, not at skins and animations.
/// @param place  For messages: the file.
/// @throws core::InputError for an accessor that goes beyond the end of its array, and for
/// corners of a geometry that come from an array of names.
void check_collada(std::string_view text, const std::string& place);

}  // namespace segsim::worlds::internal
