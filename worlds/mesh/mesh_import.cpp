#include "worlds/mesh/mesh_import.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <glm/common.hpp>

#include "core/check.h"
#include "core/error.h"
#include "worlds/mesh/internal/mesh_parts.h"

namespace segsim::worlds {
namespace {

namespace fs = std::filesystem;

bool is_y_up(const fs::path& file, UpAxis up) {
  if (up != UpAxis::kAuto) return up == UpAxis::kY;
  const std::string extension = internal::lower_case_extension(file);
  return extension == ".glb" || extension == ".gltf" || extension == ".obj" ||
         extension == ".fbx";
}

glm::dmat4 world_from_file(bool y_up, double scale) {
  glm::dmat4 T_world_file(0.0);
  T_world_file[0] = glm::dvec4(scale, 0, 0, 0);
  T_world_file[1] = y_up ? glm::dvec4(0, 0, scale, 0) : glm::dvec4(0, scale, 0, 0);
  T_world_file[2] = y_up ? glm::dvec4(0, -scale, 0, 0) : glm::dvec4(0, 0, scale, 0);
  T_world_file[3] = glm::dvec4(0, 0, 0, 1);
  return T_world_file;
}

}  // namespace

void add_ceiling_lights(sim::MeshScene& scene, double height_m, double spacing_m) {
  SEGSIM_CHECK(spacing_m > 0, std::to_string(spacing_m));
  glm::vec3 low(std::numeric_limits<float>::max());
  glm::vec3 high(-low);
  for (const sim::SubMesh& mesh : scene.meshes) {
    for (const glm::vec3& vertex : mesh.positions_m) {
      low = glm::min(low, vertex);
      high = glm::max(high, vertex);
    }
  }
  if (low.x > high.x) return;
  const double size_x_m = static_cast<double>(high.x) - static_cast<double>(low.x);
  const double size_y_m = static_cast<double>(high.y) - static_cast<double>(low.y);
  const int columns = std::max(1, static_cast<int>(std::lround(size_x_m / spacing_m)));
  const int rows = std::max(1, static_cast<int>(std::lround(size_y_m / spacing_m)));
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      sim::PointLight light;
      light.position_m = {
          low.x + static_cast<float>((column + 0.5) / columns * size_x_m),
          low.y + static_cast<float>((row + 0.5) / rows * size_y_m),
          static_cast<float>(height_m - 0.45),
      };
      light.radiance = glm::vec3(2.1F, 2.0F, 1.81F);
      light.radius_m = 0.35F;
      scene.lights.push_back(light);
    }
  }
}

sim::MeshScene load_mesh_file(const fs::path& file, const MeshFileOptions& options,
                              const TextureReader& textures) {
  SEGSIM_CHECK(options.scale > 0, std::to_string(options.scale));
  sim::MeshScene scene;
  scene.name = file.stem().string();
  scene.source = "mesh file " + file.filename().string();
  internal::MeshFileReader reader(scene, textures);
  LabelTable labels(scene);
  std::map<std::string, LabelTable::Ids> ids_of_node;
  const glm::dmat4 T_world_file = world_from_file(is_y_up(file, options.up), options.scale);
  for (const internal::MeshPart& part : reader.read(file)) {
    const std::string& name = part.node_name.empty() ? scene.name : part.node_name;
    auto known = ids_of_node.find(name);
    if (known == ids_of_node.end()) known = ids_of_node.emplace(name, labels.add(name)).first;
    internal::place_part(scene, part, T_world_file, known->second);
  }
  if (scene.triangle_count() == 0) {
    throw core::InputError::expected(file.string(), "triangles", "none");
  }
  set_instance_boxes(scene);
  if (options.add_lights) {
    float top_m = std::numeric_limits<float>::lowest();
    for (const sim::SubMesh& mesh : scene.meshes) {
      for (const glm::vec3& vertex : mesh.positions_m) top_m = std::max(top_m, vertex.z);
    }
    add_ceiling_lights(scene, static_cast<double>(top_m));
  }
  return scene;
}

}  // namespace segsim::worlds
