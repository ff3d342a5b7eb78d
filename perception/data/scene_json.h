#pragma once

/// @file
/// The places that images show, as JSON: in a data set ("segsim_scenes") and in the record of
/// what weights were trained on ("scenes").
///
///     [{"name": "flat-3", "surfels_sha256": "..."},
///      {"generator": "source_rooms/1", "first_seed": 1, "last_seed": 250}]

#include <optional>
#include <string>
#include <vector>

#include "perception/data/dataset.h"
#include "perception/data/json_node.h"

namespace segsim::perception {

/// A SHA-256 in lower-case hexadecimal digits.
/// @throws core::InputError at the node's place.
[[nodiscard]] std::string read_sha256(const JsonNode& node);

/// @throws core::InputError at the place of what is no scene.
[[nodiscard]] std::vector<ImagedScene> read_scenes(const JsonNode& node);
[[nodiscard]] Json scenes_json(const std::vector<ImagedScene>& scenes);

}  // namespace segsim::perception
