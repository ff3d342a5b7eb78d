#include "experiments/scripted_trials/geo_path.h"

#include <cmath>
#include <string>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"

namespace segsim::experiments::scripted_trials {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

/// What a file holds of paths.
struct Found {
  std::vector<Json> lines;  ///< Coordinates of each LineString.
  Json points = Json::array();
};

void collect(const Json& json, Found& found) {
  const std::string type = json.at("type").get<std::string>();
  if (type == "FeatureCollection") {
    for (const Json& feature : json.at("features")) collect(feature, found);
  } else if (type == "Feature") {
    if (!json.at("geometry").is_null()) collect(json.at("geometry"), found);
  } else if (type == "GeometryCollection") {
    for (const Json& part : json.at("geometries")) collect(part, found);
  } else if (type == "LineString") {
    found.lines.push_back(json.at("coordinates"));
  } else if (type == "Point") {
    found.points.push_back(json.at("coordinates"));
  } else if (type == "MultiPoint") {
    for (const Json& point : json.at("coordinates")) found.points.push_back(point);
  }
}

sim::GeodeticPoint position_from(const Json& json, const fs::path& file) {
  const auto longitude = json.at(0).get<double>(), latitude = json.at(1).get<double>();
  const bool on_globe = std::abs(latitude) <= 90.0 && std::abs(longitude) <= 180.0;
  if (!on_globe) {
    throw core::InputError::expected(
        file.string(), "[longitude, latitude] in degrees (in this order)", json.dump());
  }
  return {latitude, longitude, json.size() > 2 ? json.at(2).get<double>() : 0.0};
}

}  // namespace

std::vector<sim::GeodeticPoint> read_geojson_path(const fs::path& file) {
  Found found;
  std::vector<sim::GeodeticPoint> path;
  const std::string text = core::read_file(file);
  try {
    collect(Json::parse(text), found);
    if (found.lines.size() <= 1) {
      for (const Json& position : found.lines.empty() ? found.points : found.lines[0]) {
        path.push_back(position_from(position, file));
      }
    }
  } catch (const Json::exception& error) {
    throw core::InputError::expected(file.string(), "GeoJSON", error.what());
  }
  if (found.lines.size() > 1) {
    throw core::InputError::expected(file.string(), "one LineString",
                                     std::to_string(found.lines.size()));
  }
  if (path.size() < 2) {
    throw core::InputError::expected(file.string(),
                                     "a LineString, or Points, of two positions or more",
                                     std::to_string(path.size()));
  }
  return path;
}

}  // namespace segsim::experiments::scripted_trials
