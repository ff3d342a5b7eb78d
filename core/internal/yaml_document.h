#pragma once

/// @file
/// What yaml-cpp takes without a word: a key that stands twice, of which it keeps the first,
/// and aliases of aliases, with which a page of text stands for terabytes of nodes.

#include <string>

namespace segsim::core::internal {

/// @param origin  File name or other source, for messages.
/// @throws InputError naming the line: not YAML, a key twice in one map, a key that is no
///     text, or more than a million nodes once all aliases are replaced.
void check_yaml(const std::string& text, const std::string& origin);

}  // namespace segsim::core::internal
