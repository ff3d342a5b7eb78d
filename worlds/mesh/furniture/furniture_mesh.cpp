#include <fstream>
#include <limits>

#include <glm/common.hpp>

#include "core/error.h"
#include "core/process/temporary_folder.h"
#include "worlds/mesh/furniture/furniture_catalogue.h"
#include "worlds/mesh/furniture/internal/zip_archive.h"
#include "worlds/mesh/internal/mesh_parts.h"

namespace segsim::worlds {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostTriangles = 1'000'000;
/// Of all entries beside one mesh, so that a small zip file cannot fill the disk.
constexpr std::size_t kMostUnpacked_bytes = std::size_t{256} << 20U;

/// Writes a model's mesh and all that lies beside it, because materials and textures are found
/// as files of the mesh's folder.
void unpack(const FurnitureModel& model, const fs::path& folder) {
  const internal::ZipArchive zip(model.library);
  const std::string below = model.mesh.substr(0, model.mesh.find_last_of('/') + 1);
  std::size_t total_bytes = 0;
  for (const auto& [entry, size_bytes] : zip.sizes_bytes()) {
    if (!entry.starts_with(below)) continue;
    total_bytes += size_bytes;
    if (total_bytes > kMostUnpacked_bytes) {
      throw core::InputError::expected(
          model.library.string() + ": " + below,
          "at most " + std::to_string(kMostUnpacked_bytes) + " bytes", "more");
    }
    fs::create_directories((folder / entry).parent_path());
    std::ofstream(folder / entry, std::ios::binary) << zip.read(entry);
  }
}

struct Box {
  glm::dvec3 low{std::numeric_limits<double>::max()};
  glm::dvec3 high{std::numeric_limits<double>::lowest()};
};

/// World axes of a part's vertex: upright, then y up becomes z up.
glm::dmat4 T_object_file(const glm::dmat3& R_upright_file) {
  const glm::dmat3 R_object_upright({1, 0, 0}, {0, 0, 1}, {0, -1, 0});
  return glm::dmat4(R_object_upright * R_upright_file);
}

}  // namespace

sim::MeshScene load_furniture_mesh(const FurnitureModel& model,
                                   const TextureReader& textures) {
  const std::string place = model.library.string() + ": " + model.mesh;
  const core::TemporaryFolder folder("segsim_furniture");
  unpack(model, folder.path());
  sim::MeshScene scene;
  scene.name = model.id;
  scene.source = "furniture model " + model.id;
  internal::MeshFileReader reader(scene, textures);
  const std::vector<internal::MeshPart>& parts = reader.read(folder.path() / model.mesh);

  const glm::dmat4 T_object = T_object_file(glm::dmat3(model.R_upright_file));
  Box box;
  std::size_t triangles = 0;
  for (const internal::MeshPart& part : parts) {
    triangles += part.triangles.size();
    for (const glm::uvec3& triangle : part.triangles) {
      for (int corner = 0; corner < 3; ++corner) {
        const glm::dvec3 p(T_object * glm::dvec4(part.positions[triangle[corner]], 1.0));
        box.low = glm::min(box.low, p);
        box.high = glm::max(box.high, p);
      }
    }
  }
  if (triangles == 0 || triangles > kMostTriangles) {
    throw core::InputError::expected(place,
                                     "1 to " + std::to_string(kMostTriangles) + " triangles",
                                     std::to_string(triangles));
  }
  // A flat model (a rug drawn as one face) keeps its thickness of zero.
  const glm::dvec3 extent = box.high - box.low;
  glm::dmat4 T_scaled_object(1.0);
  for (int axis = 0; axis < 3; ++axis) {
    const double scale =
        extent[axis] > 0.0 ? static_cast<double>(model.size_m[axis]) / extent[axis] : 1.0;
    const double origin = axis < 2 ? 0.5 * (box.low[axis] + box.high[axis]) : box.low[axis];
    T_scaled_object[axis][axis] = scale;
    T_scaled_object[3][axis] = -scale * origin;
  }
  for (const internal::MeshPart& part : parts) {
    internal::place_part(scene, part, T_scaled_object * T_object, {});
  }
  return scene;
}

}  // namespace segsim::worlds
