#include "sim/ground/geodesy.h"

#include <cmath>
#include <cstdio>
#include <ostream>

#include <GeographicLib/LocalCartesian.hpp>

#include "core/check.h"
#include "core/file_io.h"

namespace segsim::sim {
namespace {

GeographicLib::LocalCartesian tangent_plane(const core::GeodeticOrigin& origin) {
  return {origin.latitude_deg, origin.longitude_deg, origin.height_m};
}

std::string escape_json(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      char code[8];
      std::snprintf(code, sizeof code, "\\u%04x", static_cast<unsigned>(c));
      out += code;
    } else {
      out += c;
    }
  }
  return out;
}

std::string escape_xml(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        // Control characters do not exist in XML 1.0.
        if (static_cast<unsigned char>(c) >= 0x20 || c == '\n' || c == '\t') out += c;
    }
  }
  return out;
}

/// "lon,lat,h" with 1e-9 degrees (0.1 mm) and millimetres.
std::string lon_lat_height(const LocalFrame& frame, const glm::dvec2& p_m) {
  const GeodeticPoint point = frame.to_geodetic({p_m.x, p_m.y, 0.0});
  char text[96];
  std::snprintf(text, sizeof text, "%.9f,%.9f,%.3f", point.longitude_deg, point.latitude_deg,
                point.height_m);
  return text;
}

/// Named places of a track, in the order in which both formats show them.
std::vector<std::pair<std::string, glm::dvec2>> places(const GeoTrack& track) {
  std::vector<std::pair<std::string, glm::dvec2>> list = {{"start", track.positions_m.front()},
                                                          {"end", track.positions_m.back()}};
  if (track.goal_m) list.emplace_back("goal", *track.goal_m);
  return list;
}

/// A line has at least two positions in both formats.
std::vector<glm::dvec2> line_positions(const GeoTrack& track) {
  SEGSIM_CHECK(!track.positions_m.empty(), "track without positions");
  std::vector<glm::dvec2> line = track.positions_m;
  if (line.size() == 1) line.push_back(line.front());
  return line;
}

}  // namespace

GeodeticPoint LocalFrame::to_geodetic(const glm::dvec3& p_world_m) const {
  const double c = std::cos(origin_.yaw_rad);
  const double s = std::sin(origin_.yaw_rad);
  const double east_m = c * p_world_m.x - s * p_world_m.y;
  const double north_m = s * p_world_m.x + c * p_world_m.y;
  GeodeticPoint point;
  tangent_plane(origin_).Reverse(east_m, north_m, p_world_m.z, point.latitude_deg,
                                 point.longitude_deg, point.height_m);
  return point;
}

glm::dvec3 LocalFrame::from_geodetic(const GeodeticPoint& point) const {
  double east_m = 0.0;
  double north_m = 0.0;
  double up_m = 0.0;
  tangent_plane(origin_).Forward(point.latitude_deg, point.longitude_deg, point.height_m,
                                 east_m, north_m, up_m);
  const double c = std::cos(origin_.yaw_rad);
  const double s = std::sin(origin_.yaw_rad);
  return {c * east_m + s * north_m, -s * east_m + c * north_m, up_m};
}

void write_track_geojson(const std::filesystem::path& file, const LocalFrame& frame,
                         const GeoTrack& track) {
  const std::vector<glm::dvec2> line = line_positions(track);
  core::write_file_atomically(file, [&](std::ostream& out) {
    out << R"({"type":"FeatureCollection","features":[)" << '\n'
        << R"({"type":"Feature","properties":{"name":")" << escape_json(track.name) << '"';
    for (const auto& [key, value] : track.properties) {
      out << ",\"" << escape_json(key) << "\":\"" << escape_json(value) << '"';
    }
    out << R"(},"geometry":{"type":"LineString","coordinates":[)";
    for (std::size_t k = 0; k < line.size(); ++k) {
      out << (k > 0 ? "," : "") << '[' << lon_lat_height(frame, line[k]) << ']';
    }
    out << "]}}";
    for (const auto& [name, p_m] : places(track)) {
      out << ",\n"
          << R"({"type":"Feature","properties":{"name":")" << name
          << R"("},"geometry":{"type":"Point","coordinates":[)" << lon_lat_height(frame, p_m)
          << "]}}";
    }
    out << "\n]}\n";
  });
}

void write_track_kml(const std::filesystem::path& file, const LocalFrame& frame,
                     const GeoTrack& track) {
  const std::vector<glm::dvec2> line = line_positions(track);
  core::write_file_atomically(file, [&](std::ostream& out) {
    out << "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
        << "<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document>\n<name>"
        << escape_xml(track.name) << "</name>\n<Placemark><name>" << escape_xml(track.name)
        << "</name><ExtendedData>";
    for (const auto& [key, value] : track.properties) {
      out << "<Data name=\"" << escape_xml(key) << "\"><value>" << escape_xml(value)
          << "</value></Data>";
    }
    out << "</ExtendedData><LineString><coordinates>";
    for (std::size_t k = 0; k < line.size(); ++k) {
      out << (k > 0 ? " " : "") << lon_lat_height(frame, line[k]);
    }
    out << "</coordinates></LineString></Placemark>\n";
    for (const auto& [name, p_m] : places(track)) {
      out << "<Placemark><name>" << name << "</name><Point><coordinates>"
          << lon_lat_height(frame, p_m) << "</coordinates></Point></Placemark>\n";
    }
    out << "</Document></kml>\n";
  });
}

}  // namespace segsim::sim
