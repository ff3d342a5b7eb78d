#include <cmath>
#include <cstring>
#include <span>
#include <utility>

#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <assimp/Importer.hpp>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "core/error.h"
#include "worlds/mesh/internal/mesh_parts.h"

namespace segsim::worlds::internal {
namespace {

namespace fs = std::filesystem;

core::Image<core::Rgb8> from_embedded(const aiTexture& texture, const TextureReader& reader) {
  if (texture.mHeight != 0) {
    core::Image<core::Rgb8> image(static_cast<int>(texture.mWidth),
                                  static_cast<int>(texture.mHeight));
    for (std::size_t i = 0; i < image.size(); ++i) {
      const aiTexel& texel = texture.pcData[i];
      image.data()[i] = {texel.r, texel.g, texel.b};
    }
    return image;
  }
  // A compressed image file of mWidth bytes.
  std::vector<unsigned char> bytes(texture.mWidth);
  std::memcpy(bytes.data(), texture.pcData, bytes.size());
  return reader.from_bytes(bytes);
}

/// Places where a texture may be: as the file says, then by its base name in the folders that
/// Gazebo models use, because many files name a path of the machine that they were made on.
std::vector<fs::path> texture_candidates(const std::string& name, const fs::path& folder,
                                         std::span<const fs::path> more_folders) {
  const std::size_t slash = name.find_last_of('/');
  const std::string base = slash == std::string::npos ? name : name.substr(slash + 1);
  const std::string stem = base.substr(0, base.find_last_of('.'));
  const fs::path materials = folder / ".." / "materials" / "textures";
  std::vector<fs::path> candidates{folder / name, folder / base, folder / "textures" / base,
                                   materials / base};
  for (const fs::path& more : more_folders) candidates.push_back(more / base);
  // Photoshop and Targa sources are delivered as PNG or JPEG.
  candidates.push_back(materials / (stem + ".png"));
  candidates.push_back(materials / (stem + ".jpg"));
  return candidates;
}

bool is_gltf(const fs::path& file) {
  return file.extension() == ".glb" || file.extension() == ".gltf";
}

MeshPart read_part(const aiMesh& mesh, const aiNode& node, const aiMatrix4x4& T_file_node,
                   const fs::path& file) {
  MeshPart part;
  part.node_name = node.mName.C_Str();
  part.mesh_name = mesh.mName.C_Str();
  const aiMatrix3x3 linear(T_file_node);
  aiMatrix3x3 normal_matrix = linear;
  normal_matrix.Inverse().Transpose();
  for (unsigned int i = 0; i < mesh.mNumVertices; ++i) {
    const aiVector3D p = T_file_node * mesh.mVertices[i];
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
      throw core::InputError::expected(file.string(), "finite vertices", "one that is not");
    }
    aiVector3D n = mesh.HasNormals() ? normal_matrix * mesh.mNormals[i] : aiVector3D(0, 0, 1);
    n.NormalizeSafe();
    part.positions.emplace_back(p.x, p.y, p.z);
    part.normals.emplace_back(n.x, n.y, n.z);
    const aiVector3D uv =
        mesh.HasTextureCoords(0) ? mesh.mTextureCoords[0][i] : aiVector3D(0, 0, 0);
    part.uvs.emplace_back(uv.x, uv.y);
  }
  const bool mirrored = linear.Determinant() < 0;
  for (unsigned int i = 0; i < mesh.mNumFaces; ++i) {
    const aiFace& face = mesh.mFaces[i];
    if (face.mNumIndices != 3) continue;
    glm::uvec3 triangle(face.mIndices[0], face.mIndices[1], face.mIndices[2]);
    if (mirrored) std::swap(triangle.y, triangle.z);
    part.triangles.push_back(triangle);
  }
  return part;
}

}  // namespace

glm::vec3 linear_colour(const glm::vec3& srgb) {
  glm::vec3 linear;
  for (int i = 0; i < 3; ++i) {
    const float c = std::fmin(std::fmax(srgb[i], 0.0F), 1.0F);
    linear[i] = c <= 0.04045F ? c / 12.92F : std::pow((c + 0.055F) / 1.055F, 2.4F);
  }
  return linear;
}

int MeshFileReader::add_texture(const std::string& key, core::Image<core::Rgb8> image) {
  scene_.textures.push_back(std::move(image));
  return textures_[key] = static_cast<int>(scene_.textures.size()) - 1;
}

int MeshFileReader::texture(const aiScene& file_scene, const std::string& name,
                            const fs::path& file) {
  if (const aiTexture* embedded = file_scene.GetEmbeddedTexture(name.c_str())) {
    const std::string key = file.string() + "#" + name;
    if (const auto known = textures_.find(key); known != textures_.end()) return known->second;
    core::Image<core::Rgb8> image = from_embedded(*embedded, pixels_);
    if (!image.empty()) return add_texture(key, std::move(image));
  } else {
    std::string path = name;
    for (char& c : path) c = c == '\\' ? '/' : c;
    for (const fs::path& candidate :
         texture_candidates(path, file.parent_path(), texture_folders_)) {
      std::error_code error;
      const std::string key = fs::canonical(candidate, error).string();
      if (error || !fs::is_regular_file(key)) continue;
      if (const auto known = textures_.find(key); known != textures_.end())
        return known->second;
      core::Image<core::Rgb8> image = pixels_.from_file(key);
      if (!image.empty()) return add_texture(key, std::move(image));
    }
  }
  scene_.warnings.push_back("missing texture: " + name + " of " + file.filename().string());
  return -1;
}

sim::Material MeshFileReader::read_material(const aiScene& file_scene,
                                            const aiMaterial& source, const fs::path& file) {
  sim::Material material;
  aiColor3D colour;
  if (source.Get(AI_MATKEY_COLOR_DIFFUSE, colour) == AI_SUCCESS) {
    material.albedo = glm::vec3(colour.r, colour.g, colour.b);
    // glTF stores linear factors; the older formats store what their editor showed.
    if (!is_gltf(file)) material.albedo = linear_colour(material.albedo);
  }
  if (source.Get(AI_MATKEY_COLOR_EMISSIVE, colour) == AI_SUCCESS) {
    material.emission = glm::vec3(colour.r, colour.g, colour.b);
  }
  aiString name;
  if (source.GetTexture(aiTextureType_DIFFUSE, 0, &name) == AI_SUCCESS) {
    material.texture = texture(file_scene, name.C_Str(), file);
    if (material.texture >= 0 && !is_gltf(file)) material.albedo = glm::vec3(1.0F);
  }
  return material;
}

const std::vector<MeshPart>& MeshFileReader::read(const fs::path& file) {
  const std::string key = file.lexically_normal().string();
  if (const auto known = files_.find(key); known != files_.end()) return known->second;
  if (!fs::is_regular_file(file)) {
    throw core::InputError::expected(file.string(), "a mesh file", "none");
  }
  Assimp::Importer importer;
  // Gazebo, too, takes COLLADA's coordinates as they are; the unit is applied by the root
  // node.
  importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
  const aiScene* file_scene = importer.ReadFile(
      file.string(), aiProcess_Triangulate | aiProcess_GenSmoothNormals |
                         aiProcess_JoinIdenticalVertices | aiProcess_SortByPType);
  if (file_scene == nullptr || file_scene->mRootNode == nullptr) {
    throw core::InputError::expected(file.string(), "a readable mesh",
                                     importer.GetErrorString());
  }
  std::vector<int> materials;
  for (unsigned int i = 0; i < file_scene->mNumMaterials; ++i) {
    scene_.materials.push_back(read_material(*file_scene, *file_scene->mMaterials[i], file));
    materials.push_back(static_cast<int>(scene_.materials.size()) - 1);
  }

  std::vector<MeshPart> parts;
  struct Visit {
    const aiNode* node;
    aiMatrix4x4 T_file_node;
  };
  std::vector<Visit> stack{{file_scene->mRootNode, file_scene->mRootNode->mTransformation}};
  while (!stack.empty()) {
    const Visit visit = stack.back();
    stack.pop_back();
    for (unsigned int i = 0; i < visit.node->mNumMeshes; ++i) {
      const aiMesh& mesh = *file_scene->mMeshes[visit.node->mMeshes[i]];
      if ((mesh.mPrimitiveTypes & aiPrimitiveType_TRIANGLE) == 0U) continue;
      MeshPart part = read_part(mesh, *visit.node, visit.T_file_node, file);
      part.material = materials[mesh.mMaterialIndex];
      parts.push_back(std::move(part));
    }
    // Children in reverse, so that they are visited in the file's order.
    for (unsigned int i = visit.node->mNumChildren; i-- > 0;) {
      const aiNode* child = visit.node->mChildren[i];
      stack.push_back({child, visit.T_file_node * child->mTransformation});
    }
  }
  return files_[key] = std::move(parts);
}

void place_part(sim::MeshScene& scene, const MeshPart& part, const glm::dmat4& T_world_part,
                const LabelTable::Ids& ids) {
  const glm::dmat3 linear(T_world_part);
  const glm::dmat3 normal_matrix = glm::transpose(glm::inverse(linear));
  sim::SubMesh mesh;
  mesh.material = part.material;
  mesh.class_id = ids.class_id;
  mesh.instance_id = ids.instance_id;
  mesh.uvs = part.uvs;
  mesh.triangles = part.triangles;
  mesh.positions_m.reserve(part.positions.size());
  mesh.normals.reserve(part.normals.size());
  for (const glm::vec3& p : part.positions) {
    mesh.positions_m.emplace_back(glm::dvec3(T_world_part * glm::dvec4(p, 1.0)));
  }
  for (const glm::vec3& n : part.normals) {
    const glm::dvec3 turned = normal_matrix * glm::dvec3(n);
    const double length = glm::length(turned);
    mesh.normals.emplace_back(length > 0 ? turned / length : glm::dvec3(0, 0, 1));
  }
  if (glm::determinant(linear) < 0) {
    for (glm::uvec3& triangle : mesh.triangles) std::swap(triangle.y, triangle.z);
  }
  scene.meshes.push_back(std::move(mesh));
}

}  // namespace segsim::worlds::internal
