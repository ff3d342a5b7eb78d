#pragma once

/// @file
/// PLY files of others. Libraries that read them believe what the header says: one reads on
/// for ever where it does not end, another ends the process at colours that it does not know.

#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace segsim::core {

/// @param place  For messages: the file.
/// @throws InputError unless `bytes` have a header of known lines that ends, and a body with
/// all the numbers that it promises, each of them a number.
void check_ply(std::string_view bytes, const std::string& place);

/// A property of an element that is no list.
struct PlyProperty {
  std::string type;            ///< "uchar", "float", ...: the short names.
  std::vector<double> values;  ///< One for each element.
};

/// Those of `names` that the element has, after the same checks.
[[nodiscard]] std::map<std::string, PlyProperty> read_ply_properties(
    std::string_view bytes, const std::string& place, std::string_view element,
    std::span<const std::string_view> names);

}  // namespace segsim::core
