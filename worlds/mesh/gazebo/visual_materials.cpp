#include "worlds/mesh/gazebo/internal/visual_materials.h"

#include <algorithm>

#include <ignition/math/Color.hh>

#include "worlds/mesh/internal/mesh_parts.h"

namespace segsim::worlds::internal {
namespace {

namespace fs = std::filesystem;

std::optional<glm::vec3> colour(const sdf::ElementPtr& material, const std::string& key) {
  if (!material->HasElement(key)) return std::nullopt;
  const auto rgba = material->Get<ignition::math::Color>(key);
  return glm::vec3(rgba.R(), rgba.G(), rgba.B());
}

/// The albedo map of the workflow that is there; empty if none is.
std::string albedo_map(const sdf::ElementPtr& material) {
  if (!material->HasElement("pbr")) return {};
  const sdf::ElementPtr pbr = material->GetElement("pbr");
  for (const char* workflow : {"metal", "specular"}) {
    if (!pbr->HasElement(workflow)) continue;
    const sdf::ElementPtr maps = pbr->GetElement(workflow);
    if (maps->HasElement("albedo_map")) return maps->Get<std::string>("albedo_map");
  }
  return {};
}

std::vector<fs::path> script_files(const fs::path& place) {
  if (fs::is_regular_file(place)) return {place};
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(place)) {
    if (entry.path().extension() == ".material") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

std::optional<fs::path> VisualMaterials::script_texture(
    const ScriptedMaterial& material, const std::vector<fs::path>& folders) const {
  std::vector<fs::path> places{material.folder, material.folder / ".." / "textures"};
  places.insert(places.end(), folders.begin(), folders.end());
  for (const fs::path& place : places) {
    if (fs::is_regular_file(place / material.texture)) return place / material.texture;
  }
  return finder_.find(material.texture, material.folder);
}

std::optional<ScriptedMaterial> VisualMaterials::scripted(const sdf::ElementPtr& script,
                                                          const std::string& user) {
  const auto name = script->Get<std::string>("name");
  const fs::path from = fs::path(script->FilePath()).parent_path();
  std::vector<fs::path> folders;
  for (sdf::ElementPtr uri = script->GetElement("uri"); uri != nullptr;
       uri = uri->GetNextElement("uri")) {
    const auto place = finder_.find(uri->Get<std::string>(), from);
    if (!place) continue;
    if (fs::is_directory(*place)) folders.push_back(*place);
    for (const fs::path& file : script_files(*place)) scripts_.add_file(file);
  }
  std::optional<ScriptedMaterial> own = gazebo_material(name);
  const ScriptedMaterial* known = scripts_.find(name);
  if (known == nullptr) {
    if (!own) missing_.add(MissingKind::kMaterial, name, user);
    return own;
  }
  ScriptedMaterial material = *known;
  if (!material.texture.empty()) {
    const auto texture = script_texture(material, folders);
    if (!texture && own) return own;
    if (!texture) missing_.add(MissingKind::kTexture, material.texture, name);
    material.texture = texture ? texture->string() : std::string();
  }
  return material;
}

std::optional<PlannedMaterial> VisualMaterials::plan(const sdf::Visual& visual,
                                                     const std::string& user) {
  if (visual.Material() == nullptr) return std::nullopt;
  const sdf::ElementPtr element = visual.Material()->Element();
  if (element == nullptr) return std::nullopt;
  PlannedMaterial planned;
  std::optional<glm::vec3> diffuse;
  std::optional<glm::vec3> emissive;
  bool is_known = false;
  if (element->HasElement("script")) {
    if (const auto script = scripted(element->GetElement("script"), user)) {
      is_known = true;
      diffuse = script->diffuse;
      emissive = script->emissive;
      planned.texture = script->texture;
    }
  }
  if (const std::string map = albedo_map(element); !map.empty()) {
    if (const auto file = finder_.find(map, fs::path(element->FilePath()).parent_path())) {
      planned.texture = *file;
      diffuse.reset();
    } else {
      missing_.add(MissingKind::kTexture, map, user);
    }
  }
  if (const auto written = colour(element, "diffuse")) diffuse = written;
  if (const auto written = colour(element, "emissive")) emissive = written;
  if (!diffuse && planned.texture.empty()) diffuse = colour(element, "ambient");
  if (!is_known && !diffuse && planned.texture.empty()) return std::nullopt;
  if (diffuse) {
    planned.colours.albedo = linear_colour(*diffuse);
  } else if (!planned.texture.empty()) {
    planned.colours.albedo = glm::vec3(1.0F);
  }
  if (emissive) planned.colours.emission = lamp_emission(linear_colour(*emissive));
  return planned;
}

}  // namespace segsim::worlds::internal
