#pragma once

/// @file
/// From the flat world of a scene to the globe and back, and tracks that a map program can
/// show.
///
/// The world is the tangent plane at the scene's origin, so heights above the ellipsoid grow
/// by d^2 / 2R: 0.8 mm at 100 m.

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "core/scene_bundle.h"

namespace segsim::sim {

struct GeodeticPoint {
  double latitude_deg = 0.0, longitude_deg = 0.0, height_m = 0.0;
};

/// World frame <-> WGS84.
class LocalFrame {
 public:
  explicit LocalFrame(const core::GeodeticOrigin& origin) : origin_(origin) {}
  [[nodiscard]] GeodeticPoint to_geodetic(const glm::dvec3& p_world_m) const;
  [[nodiscard]] glm::dvec3 from_geodetic(const GeodeticPoint& point) const;
  [[nodiscard]] const core::GeodeticOrigin& origin() const { return origin_; }

 private:
  core::GeodeticOrigin origin_;
};

/// A driven path with what should be shown beside it.
struct GeoTrack {
  std::string name;
  std::vector<glm::dvec2> positions_m;  ///< World frame, in the order driven; not empty.
  std::optional<glm::dvec2> goal_m;
  std::vector<std::pair<std::string, std::string>> properties;  ///< Text, shown as given.
};

/// RFC 7946: a LineString [lon, lat, h] and points "start", "end" and, if known, "goal".
void write_track_geojson(const std::filesystem::path& file, const LocalFrame& frame,
                         const GeoTrack& track);
/// KML 2.2 with the same content.
void write_track_kml(const std::filesystem::path& file, const LocalFrame& frame,
                     const GeoTrack& track);

}  // namespace segsim::sim
