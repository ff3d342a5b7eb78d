#pragma once

/// @file
/// libtorch 1.13 has vectors of a class that is not yet complete. GCC takes them; Clang 14
/// does not in C++20, where members of a vector are constexpr and so looked at early. Included
/// before everything else, this makes vectors whose members are not.

#include <memory>
#include <string>

#pragma push_macro("_GLIBCXX20_CONSTEXPR")
#undef _GLIBCXX20_CONSTEXPR
#define _GLIBCXX20_CONSTEXPR inline
// Other headers have declared it as constexpr already.
#define __fill_a1 fill_bits_of_a_vector
#include <vector>
#undef __fill_a1
#pragma pop_macro("_GLIBCXX20_CONSTEXPR")
