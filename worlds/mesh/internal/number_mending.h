#pragma once

/// @file
/// Numbers in mesh files that assimp cannot parse, or parses wrongly without a word.

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

namespace segsim::worlds::internal {

/// A number as assimp reads it: itself if nothing is wrong with it; "1.5" for "1,5"; what
/// begins it for "1e" and "3.2f"; "0" for what is not finite ("nan", "1.#QNAN", "1e999") or no
/// number at all.
[[nodiscard]] std::string mended_number(std::string_view number);

struct MendedText {
  bool changed = false;   ///< In any way, blanks included.
  std::size_t count = 0;  ///< Numbers with another value or spelling than in the file.
  std::string first;      ///< The first of them, as the file has it.
  std::string text;       ///< Empty unless `changed`.
};

/// The text of a COLLADA (.dae) or OBJ file with all coordinates, matrices and colours mended;
/// unchanged for files of other kinds. A blank before the first number of a COLLADA colour,
/// which assimp 5.2 refuses, is taken away and not counted.
/// @throws core::InputError if the file cannot be read, or has a word among the indices of a
/// COLLADA file.
[[nodiscard]] MendedText mend_numbers(const std::filesystem::path& file);

}  // namespace segsim::worlds::internal
