#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <iterator>
#include <string_view>
#include <utility>

#include <assimp/DefaultIOSystem.h>
#include <assimp/MemoryIOWrapper.h>
#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <assimp/Importer.hpp>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/input/bounds.h"
#include "core/input/regular_file.h"
#include "core/pictures/ply_check.h"
#include "worlds/mesh/internal/collada_check.h"
#include "worlds/mesh/internal/mesh_parts.h"
#include "worlds/mesh/internal/number_mending.h"

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

/// What a file of OBJ materials says from its first material on: assimp crashes at a colour
/// before it. A comment if it has none.
std::string from_first_material(const std::string& text) {
  std::size_t begin = 0;
  while (begin < text.size()) {
    const std::size_t word = text.find_first_not_of(" \t\r\n", begin);
    if (word == std::string::npos) break;
    if (text.compare(word, 6, "newmtl") == 0) return text.substr(word);
    begin = std::min(text.find('\n', word), text.size());
  }
  return "# No materials.\n";
}

/// The file system without pipes and devices, which mesh files may name, with one file
/// whose text may have been mended, and with materials of OBJ files that begin with one.
class CheckedFiles final : public Assimp::DefaultIOSystem {
 public:
  CheckedFiles(std::string file, const MendedText& mended)
      : file_(std::move(file)), changed_(mended.changed), text_(mended.text) {}
  /// The default opens the file to see.
  bool Exists(const char* file) const override { return core::can_be_read(file); }
  Assimp::IOStream* Open(const char* file, const char* mode) override {
    if (!core::can_be_read(file)) return nullptr;
    if (file != file_ && lower_case_extension(file_) == ".obj") return open_materials(file);
    if (!changed_ || file != file_) return DefaultIOSystem::Open(file, mode);
    return new Assimp::MemoryIOStream(reinterpret_cast<const std::uint8_t*>(text_.data()),
                                      text_.size());
  }

 private:
  static Assimp::IOStream* open_materials(const char* file) {
    const std::string text = from_first_material(core::read_file(file));
    auto* owned = new std::uint8_t[text.size()];  // Of the stream.
    std::memcpy(owned, text.data(), text.size());
    return new Assimp::MemoryIOStream(owned, text.size(), true);
  }

  std::string file_;
  bool changed_;
  const std::string& text_;
};

/// Cutting a polygon into triangles takes the square of its corners, and more where many of
/// them lie in one line.
constexpr std::uint64_t kMostCorners = 1024, kMostCornersSquared = 300'000'000;

/// @throws InputError for polygons that triangulation would not come to the end of, and for
/// those without corners, at which assimp ends the process.
void check_polygons(const aiScene& scene, const fs::path& file) {
  std::uint64_t squared = 0;
  for (unsigned int m = 0; m < scene.mNumMeshes; ++m) {
    const aiMesh& mesh = *scene.mMeshes[m];
    for (unsigned int i = 0; i < mesh.mNumFaces; ++i) {
      const std::uint64_t corners = mesh.mFaces[i].mNumIndices;
      if (corners > 4) squared += corners * corners;
      if (corners == 0 || corners > kMostCorners || squared > kMostCornersSquared) {
        throw core::InputError::expected(
            file.string(), "polygons of 1 to " + std::to_string(kMostCorners) + " corners",
            squared > kMostCornersSquared && corners <= kMostCorners
                ? "too many large ones"
                : "one of " + std::to_string(corners));
      }
    }
  }
}

/// Not every importer looks whether what its file refers to is there.
/// @throws InputError for indices beyond vertices, meshes or materials.
void check_references(const aiScene& scene, const fs::path& file) {
  const auto expect = [&](bool is_there, const char* what) {
    if (is_there) return;
    throw core::InputError::expected(file.string(),
                                     std::string("indices of ") + what + " that are there",
                                     "one beyond them");
  };
  for (unsigned int m = 0; m < scene.mNumMeshes; ++m) {
    const aiMesh& mesh = *scene.mMeshes[m];
    expect(mesh.mMaterialIndex < scene.mNumMaterials, "materials");
    for (unsigned int i = 0; i < mesh.mNumFaces; ++i) {
      const aiFace& face = mesh.mFaces[i];
      for (unsigned int k = 0; k < face.mNumIndices; ++k) {
        expect(face.mIndices[k] < mesh.mNumVertices, "vertices");
      }
    }
  }
  std::vector<const aiNode*> nodes{scene.mRootNode};
  while (!nodes.empty()) {
    const aiNode* node = nodes.back();
    nodes.pop_back();
    if (node == nullptr) continue;
    for (unsigned int i = 0; i < node->mNumMeshes; ++i) {
      expect(node->mMeshes[i] < scene.mNumMeshes, "meshes");
    }
    nodes.insert(nodes.end(), node->mChildren, node->mChildren + node->mNumChildren);
  }
}

/// Nodes may show one mesh many times, and each time its vertices are copied.
constexpr std::uint64_t kMostVertices = 30'000'000;

/// Colour in place of one that a missing texture would have covered.
constexpr glm::vec3 kNoTexture(0.5F);

constexpr float kLeastLampEmission = 0.5F;

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
    if (!core::within_world(glm::dvec3(p.x, p.y, p.z))) {
      throw core::InputError::expected(
          file.string(), core::print("finite vertices within %g m", core::kFarthest_m),
          core::print("(%g, %g, %g)", static_cast<double>(p.x), static_cast<double>(p.y),
                      static_cast<double>(p.z)));
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

glm::vec3 lamp_emission(const glm::vec3& emission) {
  const float brightest = std::max({emission.x, emission.y, emission.z});
  return brightest < kLeastLampEmission ? glm::vec3(0.0F) : emission;
}

std::string lower_case_extension(const fs::path& file) {
  std::string extension = file.extension().string();
  for (char& c : extension) {
    c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  return extension;
}

std::vector<fs::path> texture_files(const std::string& name, const fs::path& folder,
                                    const UriFinder& find_uri) {
  std::string path = name;
  std::replace(path.begin(), path.end(), '\\', '/');
  const std::size_t slash = path.find_last_of('/');
  const std::string base = slash == std::string::npos ? path : path.substr(slash + 1);
  const std::string stem = base.substr(0, base.find_last_of('.'));
  const fs::path materials = folder / ".." / "materials" / "textures";
  std::vector<fs::path> candidates;
  const auto add_found = [&](const std::string& uri) {
    if (!find_uri) return;
    if (const auto found = find_uri(uri, folder)) candidates.push_back(*found);
  };
  if (path.find(":/") != std::string::npos) add_found(path);
  for (const fs::path& place :
       {folder / path, folder / base, folder / "textures" / base, materials / base}) {
    candidates.push_back(place);
  }
  // "../../photos/a.jpg", where the model has been moved to another depth.
  std::string below = path;
  while (below.starts_with("../")) below.erase(0, 3);
  if (below != path && below.find('/') != std::string::npos) add_found(below);
  // Photoshop and Targa sources are delivered as PNG or JPEG.
  candidates.push_back(materials / (stem + ".png"));
  candidates.push_back(materials / (stem + ".jpg"));

  std::vector<fs::path> files;
  for (const fs::path& candidate : candidates) {
    std::error_code error;
    const fs::path file = fs::canonical(candidate, error);
    if (!error && core::can_be_read(file)) files.push_back(file);
  }
  return files;
}

int MeshFileReader::add_texture(const std::string& key, core::Image<core::Rgb8> image) {
  scene_.textures.push_back(std::move(image));
  return textures_[key] = static_cast<int>(scene_.textures.size()) - 1;
}

int MeshFileReader::texture_of_file(const fs::path& file) {
  const std::string key = fs::canonical(file).string();
  if (const auto known = textures_.find(key); known != textures_.end()) return known->second;
  core::Image<core::Rgb8> image = pixels_.from_file(key);
  return image.empty() ? -1 : add_texture(key, std::move(image));
}

int MeshFileReader::texture(const aiScene& file_scene, const std::string& name,
                            const fs::path& file) {
  if (const aiTexture* embedded = file_scene.GetEmbeddedTexture(name.c_str())) {
    const std::string key = file.string() + "#" + name;
    if (const auto known = textures_.find(key); known != textures_.end()) return known->second;
    core::Image<core::Rgb8> image = from_embedded(*embedded, pixels_);
    if (!image.empty()) return add_texture(key, std::move(image));
  } else {
    for (const fs::path& found : texture_files(name, file.parent_path(), find_uri_)) {
      if (const int index = texture_of_file(found); index >= 0) return index;
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
    material.emission = lamp_emission({colour.r, colour.g, colour.b});
  }
  aiString name;
  if (source.GetTexture(aiTextureType_DIFFUSE, 0, &name) == AI_SUCCESS) {
    material.texture = texture(file_scene, name.C_Str(), file);
    if (material.texture >= 0 && !is_gltf(file)) material.albedo = glm::vec3(1.0F);
    // Files whose texture covers everything often leave the colour below it black.
    if (material.texture < 0 && material.albedo == glm::vec3(0.0F)) {
      material.albedo = kNoTexture;
    }
  }
  return material;
}

const std::vector<MeshPart>& MeshFileReader::read(const fs::path& file) {
  const std::string key = file.lexically_normal().string();
  if (const auto known = files_.find(key); known != files_.end()) return known->second;
  if (!core::can_be_read(file)) {
    throw core::InputError::expected(file.string(), "a mesh file", "none");
  }
  const std::string extension = lower_case_extension(file);
  // assimp goes by the content of others, past the checks of each kind.
  constexpr std::string_view kKinds[] = {".dae", ".fbx", ".glb", ".gltf",
                                         ".obj", ".ply", ".stl"};
  if (std::find(std::begin(kKinds), std::end(kKinds), extension) == std::end(kKinds)) {
    throw core::InputError::expected(
        file.string(), "a mesh file: .dae, .fbx, .glb, .gltf, .obj, .ply or .stl",
        extension.empty() ? "a name without an ending" : extension);
  }
  if (extension == ".ply") core::check_ply(core::read_file(file), file.string());
  if (extension == ".dae") check_collada(core::read_file(file), file.string());
  const MendedText mended = mend_numbers(file);
  if (mended.count > 0) {
    scene_.warnings.push_back("mended " + std::to_string(mended.count) + " numbers of " +
                              file.filename().string() + ", the first of which is \"" +
                              mended.first + "\"");
  }
  Assimp::Importer importer;
  importer.SetIOHandler(new CheckedFiles(file.string(), mended));  // It deletes it.
  // Gazebo, too, takes COLLADA's coordinates as they are; the unit is applied by the root
  // node.
  importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
  const aiScene* file_scene = importer.ReadFile(file.string(), 0);
  if (file_scene != nullptr) {
    check_references(*file_scene, file);
    check_polygons(*file_scene, file);
    file_scene =
        importer.ApplyPostProcessing(aiProcess_Triangulate | aiProcess_GenSmoothNormals |
                                     aiProcess_JoinIdenticalVertices | aiProcess_SortByPType);
  }
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
  std::uint64_t vertices = 0;
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
      vertices += mesh.mNumVertices;
      if (vertices > kMostVertices) {
        throw core::InputError::expected(
            file.string(), "at most " + std::to_string(kMostVertices) + " vertices", "more");
      }
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
