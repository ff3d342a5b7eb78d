#include "worlds/mesh/gazebo_import.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/quaternion.hpp>
#include <ignition/math/Pose3.hh>
#include <sdf/sdf.hh>

#include "core/error.h"
#include "worlds/mesh/class_names.h"
#include "worlds/mesh/internal/mesh_parts.h"
#include "worlds/mesh/mesh_import.h"

namespace segsim::worlds {
namespace {

namespace fs = std::filesystem;
using internal::MeshPart;

glm::dmat4 matrix(const ignition::math::Pose3d& pose) {
  const glm::dquat rotation(pose.Rot().W(), pose.Rot().X(), pose.Rot().Y(), pose.Rot().Z());
  return glm::translate(glm::dmat4(1.0), {pose.X(), pose.Y(), pose.Z()}) *
         glm::mat4_cast(rotation);
}

/// A grid of vertices (columns + 1) x (rows + 1) as triangles; those without area are left
/// out. `at(u, v)` returns position and normal for u, v in [0, 1]; u x v points outwards.
template <class Surface>
void add_patch(MeshPart& part, int columns, int rows, const Surface& at) {
  const auto first = static_cast<unsigned int>(part.positions.size());
  for (int row = 0; row <= rows; ++row) {
    for (int column = 0; column <= columns; ++column) {
      const double u = static_cast<double>(column) / columns;
      const double v = static_cast<double>(row) / rows;
      const std::pair<glm::dvec3, glm::dvec3> point = at(u, v);
      part.positions.emplace_back(point.first);
      part.normals.emplace_back(point.second);
      part.uvs.emplace_back(u, v);
    }
  }
  const auto add = [&](unsigned int a, unsigned int b, unsigned int c) {
    const glm::vec3& p = part.positions[a];
    const glm::vec3 cross = glm::cross(part.positions[b] - p, part.positions[c] - p);
    if (glm::dot(cross, cross) > 0.0F) part.triangles.emplace_back(a, b, c);
  };
  const auto stride = static_cast<unsigned int>(columns) + 1U;
  for (unsigned int row = 0; row < static_cast<unsigned int>(rows); ++row) {
    for (unsigned int column = 0; column + 1U < stride; ++column) {
      const unsigned int a = first + row * stride + column;
      add(a, a + 1U, a + stride + 1U);
      add(a, a + stride + 1U, a + stride);
    }
  }
}

MeshPart sphere(double radius_m) {
  MeshPart part;
  add_patch(part, 48, 24, [&](double u, double v) {
    // The poles are exact, so that their triangles have no area.
    const double polar = std::numbers::pi * (1.0 - v);
    const double ring = v == 0.0 || v == 1.0 ? 0.0 : std::sin(polar);
    const double azimuth = 2.0 * std::numbers::pi * u;
    const glm::dvec3 n(ring * std::cos(azimuth), ring * std::sin(azimuth), std::cos(polar));
    return std::pair(radius_m * n, n);
  });
  return part;
}

MeshPart cylinder(double radius_m, double length_m) {
  MeshPart part;
  const auto rim = [&](double u) {
    const double azimuth = 2.0 * std::numbers::pi * u;
    return glm::dvec3(std::cos(azimuth), std::sin(azimuth), 0.0);
  };
  add_patch(part, 48, 1, [&](double u, double v) {
    return std::pair(radius_m * rim(u) + glm::dvec3(0, 0, (v - 0.5) * length_m), rim(u));
  });
  for (const double side : {-1.0, 1.0}) {
    add_patch(part, 48, 1, [&](double u, double v) {
      const double inwards = side > 0 ? 1.0 - v : v;
      return std::pair(inwards * radius_m * rim(u) + glm::dvec3(0, 0, 0.5 * side * length_m),
                       glm::dvec3(0, 0, side));
    });
  }
  return part;
}

MeshPart box(const glm::dvec3& size_m) {
  MeshPart part;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      glm::dvec3 n(0.0);
      n[axis] = side;
      glm::dvec3 edge_u(0.0);
      edge_u[(axis + 1) % 3] = 1.0;
      const glm::dvec3 edge_v = glm::cross(n, edge_u);
      add_patch(part, 1, 1, [&](double u, double v) {
        return std::pair(0.5 * size_m * (n + (2 * u - 1) * edge_u + (2 * v - 1) * edge_v), n);
      });
    }
  }
  return part;
}

MeshPart plane(const glm::dvec3& normal, double width_m, double height_m) {
  MeshPart part;
  const glm::dvec3 hint = std::abs(normal.x) > 0.5 ? glm::dvec3(0, 1, 0) : glm::dvec3(1, 0, 0);
  const glm::dvec3 edge_v = glm::normalize(glm::cross(normal, hint));
  const glm::dvec3 edge_u = glm::cross(edge_v, normal);
  add_patch(part, 1, 1, [&](double u, double v) {
    return std::pair((u - 0.5) * width_m * edge_u + (v - 0.5) * height_m * edge_v, normal);
  });
  return part;
}

void keep_submesh(std::vector<MeshPart>& parts, const sdf::Mesh& mesh) {
  if (mesh.Submesh().empty()) return;
  std::erase_if(parts, [&](const MeshPart& part) {
    return part.mesh_name != mesh.Submesh() && part.node_name != mesh.Submesh();
  });
  if (!mesh.CenterSubmesh()) return;
  for (MeshPart& part : parts) {
    glm::vec3 low = part.positions.front();
    glm::vec3 high = low;
    for (const glm::vec3& p : part.positions) {
      low = glm::min(low, p);
      high = glm::max(high, p);
    }
    for (glm::vec3& p : part.positions) p -= 0.5F * (low + high);
  }
}

class WorldReader {
 public:
  WorldReader(sim::MeshScene& scene, const TextureReader& textures, fs::path models_folder)
      : scene_(scene),
        models_folder_(std::move(models_folder)),
        files_(scene, textures, {models_folder_ / ".." / "photos"}),
        labels_(scene) {}

  void add_instance(const sdf::Model& model, const glm::dmat4& T_world_parent) {
    ids_ = labels_.add(model.Name());
    add_model(model, T_world_parent);
  }

 private:
  glm::dmat4 resolve(const sdf::SemanticPose& semantic_pose) {
    ignition::math::Pose3d pose;
    for (const sdf::Error& error : semantic_pose.Resolve(pose)) {
      scene_.warnings.push_back("pose: " + error.Message());
    }
    return matrix(pose);
  }

  void add_model(const sdf::Model& model, const glm::dmat4& T_world_parent) {
    const glm::dmat4 T_world_model = T_world_parent * resolve(model.SemanticPose());
    for (std::uint64_t i = 0; i < model.LinkCount(); ++i) {
      const sdf::Link& link = *model.LinkByIndex(i);
      const glm::dmat4 T_world_link = T_world_model * resolve(link.SemanticPose());
      for (std::uint64_t j = 0; j < link.VisualCount(); ++j) {
        const sdf::Visual& visual = *link.VisualByIndex(j);
        if (visual.Geom() != nullptr && visual.Transparency() < 0.99F) {
          add_visual(visual, T_world_link * resolve(visual.SemanticPose()));
        }
      }
    }
    for (std::uint64_t i = 0; i < model.ModelCount(); ++i) {
      add_model(*model.ModelByIndex(i), T_world_model);
    }
  }

  void add_visual(const sdf::Visual& visual, const glm::dmat4& T_world_visual) {
    const sdf::Geometry& geometry = *visual.Geom();
    switch (geometry.Type()) {
      case sdf::GeometryType::MESH:
        return add_mesh(*geometry.MeshShape(), T_world_visual);
      case sdf::GeometryType::SPHERE:
        return add_primitive(visual, sphere(geometry.SphereShape()->Radius()), T_world_visual);
      case sdf::GeometryType::CYLINDER:
        return add_primitive(
            visual,
            cylinder(geometry.CylinderShape()->Radius(), geometry.CylinderShape()->Length()),
            T_world_visual);
      case sdf::GeometryType::BOX: {
        const auto size = geometry.BoxShape()->Size();
        return add_primitive(visual, box({size.X(), size.Y(), size.Z()}), T_world_visual);
      }
      case sdf::GeometryType::PLANE: {
        const auto n = geometry.PlaneShape()->Normal();
        const auto size = geometry.PlaneShape()->Size();
        return add_primitive(visual, plane({n.X(), n.Y(), n.Z()}, size.X(), size.Y()),
                             T_world_visual);
      }
      default:
        scene_.warnings.push_back("visual " + visual.Name() +
                                  ": its kind of geometry is not read");
    }
  }

  void add_primitive(const sdf::Visual& visual, MeshPart part,
                     const glm::dmat4& T_world_visual) {
    sim::Material material;
    if (visual.Material() != nullptr) {
      const auto diffuse = visual.Material()->Diffuse();
      const auto emissive = visual.Material()->Emissive();
      material.albedo = internal::linear_colour({diffuse.R(), diffuse.G(), diffuse.B()});
      material.emission = internal::linear_colour({emissive.R(), emissive.G(), emissive.B()});
    }
    scene_.materials.push_back(material);
    part.material = static_cast<int>(scene_.materials.size()) - 1;
    internal::place_part(scene_, part, T_world_visual, ids_);
  }

  void add_mesh(const sdf::Mesh& mesh, const glm::dmat4& T_world_visual) {
    const auto scale = mesh.Scale();
    const glm::dmat4 T_world_mesh =
        glm::scale(T_world_visual, {scale.X(), scale.Y(), scale.Z()});
    std::vector<MeshPart> parts = files_.read(mesh_file(mesh));
    keep_submesh(parts, mesh);
    for (const MeshPart& part : parts) {
      internal::place_part(scene_, part, T_world_mesh, ids_);
    }
  }

  /// File that a mesh's URI means; need not exist.
  [[nodiscard]] fs::path mesh_file(const sdf::Mesh& mesh) const {
    const std::string uri = mesh.Uri();
    static constexpr std::string_view kModel = "model://";
    static constexpr std::string_view kFile = "file://";
    if (uri.starts_with(kModel)) return models_folder_ / uri.substr(kModel.size());
    fs::path path = uri.starts_with(kFile) ? uri.substr(kFile.size()) : uri;
    if (path.is_absolute()) return path;
    const fs::path beside = fs::path(mesh.FilePath()).parent_path() / path;
    return fs::exists(beside) ? beside : models_folder_ / ".." / path;
  }

  sim::MeshScene& scene_;
  fs::path models_folder_;
  internal::MeshFileReader files_;
  LabelTable labels_;
  LabelTable::Ids ids_;  ///< Of the instance that is being added.
};

/// Passes on what SDF reports; an include that cannot be found would silently empty a room.
void report(const sdf::Errors& errors, const fs::path& file, sim::MeshScene& scene) {
  for (const sdf::Error& error : errors) {
    if (error.Code() == sdf::ErrorCode::URI_LOOKUP ||
        error.Code() == sdf::ErrorCode::FILE_READ) {
      throw core::InputError::expected(file.string(), "readable SDF with known models",
                                       error.Message());
    }
    scene.warnings.push_back("SDF: " + error.Message());
  }
}

}  // namespace

sim::MeshScene load_gazebo_world(const fs::path& world_file,
                                 const GazeboImportOptions& options,
                                 const TextureReader& textures) {
  if (!fs::is_regular_file(world_file)) {
    throw core::InputError::expected(world_file.string(), "a Gazebo world file", "none");
  }
  const fs::path models_folder = options.models_folder.empty()
                                     ? world_file.parent_path() / ".." / "models"
                                     : options.models_folder;
  sdf::Console::Instance()->SetQuiet(true);  // Errors are returned, too.
  sdf::ParserConfig config;
  config.AddURIPath("model://", models_folder.string());
  // Old worlds are full of both; the log file of libsdformat has them.
  config.SetWarningsPolicy(sdf::EnforcementPolicy::LOG);
  config.SetDeprecatedElementsPolicy(sdf::EnforcementPolicy::LOG);

  sim::MeshScene scene;
  scene.name = world_file.stem().string();
  scene.source = "Gazebo world " + world_file.filename().string();
  sdf::Root root;
  const sdf::Errors errors = root.Load(world_file.string(), config);
  if (root.WorldCount() == 0) {
    throw core::InputError::expected(
        world_file.string(), "SDF with a world",
        errors.empty() ? std::string("none") : errors.front().Message());
  }
  report(errors, world_file, scene);

  const sdf::World& world = *root.WorldByIndex(0);
  WorldReader reader(scene, textures, models_folder);
  for (std::uint64_t i = 0; i < world.ModelCount(); ++i) {
    reader.add_instance(*world.ModelByIndex(i), glm::dmat4(1.0));
  }
  if (options.add_ceiling) {
    const fs::path ceiling_file = models_folder / options.ceiling_model / "model.sdf";
    sdf::Root ceiling;
    const sdf::Errors ceiling_errors = ceiling.Load(ceiling_file.string(), config);
    if (ceiling.Model() == nullptr) {
      throw core::InputError::expected(ceiling_file.string(), "a ceiling model", "none");
    }
    report(ceiling_errors, ceiling_file, scene);
    reader.add_instance(
        *ceiling.Model(),
        glm::translate(glm::dmat4(1.0), glm::dvec3(0.0, 0.0, options.ceiling_height_m)));
  }
  set_instance_boxes(scene);
  add_ceiling_lights(scene, options.ceiling_height_m, options.light_spacing_m);
  return scene;
}

}  // namespace segsim::worlds
