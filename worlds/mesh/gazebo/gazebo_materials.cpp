#include <algorithm>
#include <array>

#include "worlds/mesh/gazebo/internal/material_script.h"

namespace segsim::worlds::internal {
namespace {

struct Row {
  std::string_view name;  ///< Without "Gazebo/".
  glm::vec3 diffuse;
  bool glows = false;
};

/// Diffuse colours of media/materials/scripts/gazebo.material in Gazebo classic 11. Where that
/// file has a texture (from WoodFloor on), a colour that such a surface has from afar.
constexpr auto kMaterials = std::to_array<Row>({
    {"Grey", {0.7F, 0.7F, 0.7F}},
    {"Gray", {0.7F, 0.7F, 0.7F}},
    {"LightGrey", {0.8F, 0.8F, 0.8F}},
    {"DarkGrey", {0.175F, 0.175F, 0.175F}},
    {"DarkGray", {0.175F, 0.175F, 0.175F}},
    {"White", {1.0F, 1.0F, 1.0F}},
    {"FlatBlack", {0.1F, 0.1F, 0.1F}},
    {"Black", {0.0F, 0.0F, 0.0F}},
    {"Red", {1.0F, 0.0F, 0.0F}},
    {"RedBright", {0.87F, 0.26F, 0.07F}},
    {"Green", {0.0F, 1.0F, 0.0F}},
    {"Blue", {0.0F, 0.0F, 1.0F}},
    {"SkyBlue", {0.13F, 0.44F, 0.7F}},
    {"Yellow", {1.0F, 1.0F, 0.0F}},
    {"ZincYellow", {0.9725F, 0.9529F, 0.2078F}},
    {"DarkYellow", {0.7F, 0.7F, 0.0F}},
    {"Purple", {1.0F, 0.0F, 1.0F}},
    {"Turquoise", {0.0F, 1.0F, 1.0F}},
    {"Orange", {1.0F, 0.5088F, 0.0468F}},
    {"DarkOrange", {0.6F, 0.3F, 0.03F}},
    {"Indigo", {0.33F, 0.0F, 0.5F}},
    {"WhiteGlow", {1.0F, 1.0F, 1.0F}, true},
    {"RedGlow", {1.0F, 0.0F, 0.0F}, true},
    {"GreenGlow", {0.0F, 1.0F, 0.0F}, true},
    {"BlueGlow", {0.0F, 0.0F, 1.0F}, true},
    {"YellowGlow", {1.0F, 1.0F, 0.0F}, true},
    {"PurpleGlow", {1.0F, 0.0F, 1.0F}, true},
    {"TurquoiseGlow", {0.0F, 1.0F, 1.0F}, true},
    {"LightOn", {0.0F, 1.0F, 0.0F}, true},
    {"LightOff", {1.0F, 0.0F, 0.0F}, true},
    {"RedTransparent", {1.0F, 0.0F, 0.0F}},
    {"GreenTransparent", {0.0F, 1.0F, 0.0F}},
    {"BlueTransparent", {0.0F, 0.0F, 1.0F}},
    {"YellowTransparent", {1.0F, 1.0F, 0.0F}},
    {"OrangeTransparent", {1.0F, 0.44F, 0.0F}},
    {"GreyTransparent", {0.5F, 0.5F, 0.5F}},
    {"Gold", {0.8F, 0.64869F, 0.120759F}},
    {"Pioneer2Body", {0.681193F, 0.000923F, 0.000923F}},
    {"PioneerBody", {1.0F, 0.0F, 0.0F}},
    {"WoodFloor", {0.62F, 0.45F, 0.3F}},
    {"CeilingTiled", {0.82F, 0.82F, 0.8F}},
    {"PaintedWall", {0.8F, 0.77F, 0.7F}},
    {"WoodPallet", {0.64F, 0.5F, 0.34F}},
    {"Wood", {0.58F, 0.4F, 0.24F}},
    {"Bricks", {0.58F, 0.34F, 0.27F}},
    {"WindowFrame", {0.75F, 0.75F, 0.75F}},
    {"Road", {0.3F, 0.3F, 0.3F}},
    {"Residential", {0.35F, 0.35F, 0.35F}},
    {"Tertiary", {0.35F, 0.35F, 0.35F}},
    {"Pedestrian", {0.6F, 0.6F, 0.58F}},
    {"Footway", {0.6F, 0.6F, 0.58F}},
    {"Motorway", {0.3F, 0.3F, 0.3F}},
    {"Trunk", {0.3F, 0.3F, 0.3F}},
    {"Primary", {0.3F, 0.3F, 0.3F}},
    {"Secondary", {0.3F, 0.3F, 0.3F}},
    {"Steps", {0.55F, 0.55F, 0.53F}},
    {"Grass", {0.3F, 0.45F, 0.2F}},
});

}  // namespace

std::optional<ScriptedMaterial> gazebo_material(std::string_view name) {
  static constexpr std::string_view kPrefix = "Gazebo/";
  if (!name.starts_with(kPrefix)) return std::nullopt;
  name.remove_prefix(kPrefix.size());
  const auto* row = std::find_if(kMaterials.begin(), kMaterials.end(),
                                 [&](const Row& known) { return known.name == name; });
  if (row == kMaterials.end()) return std::nullopt;
  ScriptedMaterial material;
  material.diffuse = row->diffuse;
  if (row->glows) material.emissive = row->diffuse;
  return material;
}

}  // namespace segsim::worlds::internal
