#pragma once

/// @file
/// Whether a PLY file is whole, before a library of others reads it: some read on for ever at
/// a header without an end, or believe any number of elements.

#include <string>
#include <string_view>

namespace segsim::core {

/// @param place  For messages: the file.
/// @throws InputError unless `bytes` have a header of known lines that ends, and a body with
/// all the numbers that it promises, each of them a number.
void check_ply(std::string_view bytes, const std::string& place);

}  // namespace segsim::core
