#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <string_view>

#include "worlds/mesh/gazebo/internal/built_in_models.h"

namespace segsim::worlds::internal {
namespace {

namespace fs = std::filesystem;

constexpr auto kLights =
    std::to_array<std::string_view>({"sun", "directional_light", "point_light", "spot_light"});

/// Lamps of worlds are not used (see GazeboImportOptions), so any light will do.
constexpr std::string_view kLight = "<light type='point' name='light'/>";

constexpr std::string_view kGroundPlane =
    "<model name='ground_plane'><static>true</static><link name='link'><visual name='visual'>"
    "<geometry><plane><normal>0 0 1</normal><size>100 100</size></plane></geometry><material>"
    "<diffuse>0.7 0.7 0.7 1</diffuse></material></visual></link></model>";

/// "ground_plane" of "https://.../models/Ground Plane".
std::string model_name(const std::string& uri) {
  std::string name = uri.substr(uri.find_last_of('/') + 1);
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) {
    return c == ' ' ? '_' : static_cast<char>(std::tolower(c));
  });
  return name;
}

}  // namespace

std::optional<fs::path> BuiltInModels::find(const std::string& uri) {
  const std::string name = model_name(uri);
  const bool light = std::find(kLights.begin(), kLights.end(), name) != kLights.end();
  if (!light && name != "ground_plane") return std::nullopt;
  if (!folder_) folder_ = std::make_unique<core::TemporaryFolder>("segsim_models");
  const fs::path model = folder_->path() / name;
  fs::create_directories(model);
  std::ofstream(model / "model.config")
      << "<model><name>" << name << "</name><sdf version='1.6'>model.sdf</sdf></model>";
  std::ofstream(model / "model.sdf")
      << "<sdf version='1.6'>" << (light ? kLight : kGroundPlane) << "</sdf>";
  return model;
}

}  // namespace segsim::worlds::internal
