#pragma once

/// @file
/// YAML written out on one line, from layers of which the later ones win: the same text on
/// every machine, whatever library has read it.

#include <string>
#include <utility>
#include <vector>

#include "core/config.h"

namespace segsim::experiments::suites {

/// A scalar as it may stand between [ ] and { }, in quotes if it must be.
[[nodiscard]] std::string yaml_scalar(const std::string& text);

/// Maps are merged key by key, keys in the order in which they first come up; of scalars and
/// lists the last one counts. Marks all as known.
/// @param layers  One or more, the weakest first.
/// @param first  Keys and scalars of the outermost map, before all others and instead of those
///               of the same name.
[[nodiscard]] std::string flow_yaml(
    const std::vector<core::ConfigNode>& layers,
    const std::vector<std::pair<std::string, std::string>>& first = {});

}  // namespace segsim::experiments::suites
