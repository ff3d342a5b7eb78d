#pragma once

/// @file
/// Paths drawn in a map program (GeoJSON, RFC 7946).

#include <filesystem>
#include <vector>

#include "sim/ground/geodesy.h"

namespace segsim::experiments::scripted_trials {

/// Corners of the one path in the file, in order: a LineString, or several Points, alone or in
/// Features or a FeatureCollection. Positions are [longitude, latitude, height?] in degrees.
/// Points beside a LineString (marks such as "start") are not part of the path.
/// @throws core::InputError: no JSON, no path or several, a position outside of the globe.
[[nodiscard]] std::vector<sim::GeodeticPoint> read_geojson_path(
    const std::filesystem::path& file);

}  // namespace segsim::experiments::scripted_trials
