#include "worlds/mesh/gazebo/gazebo_import.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <sstream>
#include <utility>

#include <glm/common.hpp>
#include <glm/gtc/matrix_transform.hpp>

#include "core/error.h"
#include "worlds/mesh/gazebo/internal/ceiling.h"
#include "worlds/mesh/gazebo/internal/primitive_shapes.h"
#include "worlds/mesh/gazebo/internal/world_document.h"
#include "worlds/mesh/gazebo/internal/world_plan.h"
#include "worlds/mesh/internal/mesh_parts.h"
#include "worlds/mesh/mesh_import.h"

namespace segsim::worlds {
namespace {

namespace fs = std::filesystem;
using internal::MeshPart;
using internal::MissingFile;
using internal::MissingKind;
using internal::PlannedVisual;

/// How far a ground plane reaches beyond everything that stands on it.
constexpr double kGroundMargin_m = 1.0;
/// Floors lie on the ground plane, at the same height; without this, both would show.
constexpr double kGroundDepth_m = 0.005;

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

/// The floor plan of all meshes; low above high if there are none.
struct Plan {
  glm::dvec2 low{std::numeric_limits<double>::max()};
  glm::dvec2 high{std::numeric_limits<double>::lowest()};
};

Plan floor_plan(const sim::MeshScene& scene) {
  Plan plan;
  for (const sim::SubMesh& mesh : scene.meshes) {
    for (const glm::vec3& vertex : mesh.positions_m) {
      plan.low = glm::min(plan.low, glm::dvec2(vertex));
      plan.high = glm::max(plan.high, glm::dvec2(vertex));
    }
  }
  return plan;
}

/// Turns planned visuals into meshes.
class VisualLoader {
 public:
  VisualLoader(sim::MeshScene& scene, const TextureReader& textures,
               const internal::ResourceFinder& finder)
      : scene_(scene),
        files_(scene, textures, [&finder](const std::string& uri, const fs::path& folder) {
          return finder.find(uri, folder);
        }) {}

  void add(const PlannedVisual& visual) {
    const sdf::Geometry& geometry = *visual.geometry;
    switch (geometry.Type()) {
      case sdf::GeometryType::MESH:
        return add_mesh(visual);
      case sdf::GeometryType::SPHERE:
        return add_solid(visual, internal::sphere(geometry.SphereShape()->Radius()));
      case sdf::GeometryType::ELLIPSOID: {
        const auto radii = geometry.EllipsoidShape()->Radii();
        PlannedVisual stretched = visual;
        stretched.T_world_visual =
            glm::scale(visual.T_world_visual, {radii.X(), radii.Y(), radii.Z()});
        return add_solid(stretched, internal::sphere(1.0));
      }
      case sdf::GeometryType::CAPSULE:
        return add_solid(visual, internal::capsule(geometry.CapsuleShape()->Radius(),
                                                   geometry.CapsuleShape()->Length()));
      case sdf::GeometryType::CYLINDER:
        return add_solid(visual, internal::cylinder(geometry.CylinderShape()->Radius(),
                                                    geometry.CylinderShape()->Length()));
      case sdf::GeometryType::BOX: {
        const auto size = geometry.BoxShape()->Size();
        return add_solid(visual, internal::box({size.X(), size.Y(), size.Z()}));
      }
      case sdf::GeometryType::PLANE:
        planes_.push_back(&visual);
        return;
      default:
        ++unread_;
    }
  }

  /// Planes come last: those without end are cut to the world that stands on them.
  void finish() {
    const Plan plan = floor_plan(scene_);
    for (const PlannedVisual* visual : planes_) add_plane(*visual, plan);
    if (unread_ > 0) {
      scene_.warnings.push_back(std::to_string(unread_) +
                                " visuals are left out: their kind of geometry is not read");
    }
  }

 private:
  int add_material(const internal::PlannedMaterial& planned) {
    sim::Material material = planned.colours;
    if (!planned.texture.empty()) {
      material.texture = files_.texture_of_file(planned.texture);
      if (material.texture < 0) {
        scene_.warnings.push_back("unreadable texture: " + planned.texture.string());
      }
    }
    scene_.materials.push_back(material);
    return static_cast<int>(scene_.materials.size()) - 1;
  }

  void add_solid(const PlannedVisual& visual, MeshPart part) {
    part.material = add_material(visual.material.value_or(internal::PlannedMaterial{}));
    internal::place_part(scene_, part, visual.T_world_visual, visual.ids);
  }

  void add_mesh(const PlannedVisual& visual) {
    const sdf::Mesh& mesh = *visual.geometry->MeshShape();
    const auto scale = mesh.Scale();
    const glm::dmat4 T_world_mesh =
        glm::scale(visual.T_world_visual, {scale.X(), scale.Y(), scale.Z()});
    std::vector<MeshPart> parts = files_.read(visual.mesh_file);
    keep_submesh(parts, mesh);
    std::optional<int> material;
    if (visual.material) material = add_material(*visual.material);
    for (const MeshPart& part : parts) {
      internal::place_part(scene_, part, T_world_mesh, visual.ids);
      if (material) scene_.meshes.back().material = *material;
    }
  }

  void add_plane(const PlannedVisual& visual, const Plan& plan) {
    const sdf::Plane& shape = *visual.geometry->PlaneShape();
    const glm::dvec3 normal(shape.Normal().X(), shape.Normal().Y(), shape.Normal().Z());
    MeshPart part = internal::plane(normal, shape.Size().X(), shape.Size().Y());
    glm::dvec2 low(std::numeric_limits<double>::max());
    glm::dvec2 high(-low);
    for (const glm::vec3& corner : part.positions) {
      const glm::dvec2 p(visual.T_world_visual * glm::dvec4(corner, 1.0));
      low = glm::min(low, p);
      high = glm::max(high, p);
    }
    const glm::dvec2 world_low = glm::max(low, plan.low - kGroundMargin_m);
    const glm::dvec2 world_high = glm::min(high, plan.high + kGroundMargin_m);
    const glm::dvec3 up(visual.T_world_visual * glm::dvec4(normal, 0.0));
    const bool is_cut = world_low != low || world_high != high;
    if (up.z < 0.999 || !is_cut || world_low.x >= world_high.x ||
        world_low.y >= world_high.y) {
      return add_solid(visual, std::move(part));
    }
    PlannedVisual ground = visual;
    const glm::dvec2 size = world_high - world_low;
    const glm::dvec3 centre(0.5 * (world_low + world_high),
                            visual.T_world_visual[3].z - kGroundDepth_m);
    ground.T_world_visual = glm::translate(glm::dmat4(1.0), centre);
    add_solid(ground, internal::plane({0, 0, 1}, size.x, size.y));
  }

  sim::MeshScene& scene_;
  internal::MeshFileReader files_;
  std::vector<const PlannedVisual*> planes_;
  int unread_ = 0;
};

/// Refuses the world, or warns of what is left out.
void report_missing(const internal::MissingFiles& missing, const fs::path& world_file,
                    OnMissing on_missing, sim::MeshScene& scene) {
  const bool incomplete = missing.has(MissingKind::kModel) || missing.has(MissingKind::kMesh);
  if (incomplete && on_missing == OnMissing::kError) {
    throw core::InputError(
        world_file.string() + ": expected all files of the world, found " +
        std::to_string(missing.files().size()) + " missing: " + missing.text() +
        "; name their folder (--resource-path) or say what is done without them "
        "(--on-missing collision or skip)");
  }
  for (const MissingFile& file : missing.files()) {
    if (file.kind == MissingKind::kMeshTexture) continue;
    scene.warnings.push_back("missing " + internal::MissingFiles::text(file));
  }
}

/// Adds the ceiling model that the options name.
void plan_ceiling_model(const CeilingOptions& ceiling, const internal::ResourceFinder& finder,
                        sdf::Root& root, internal::MissingFiles& missing,
                        internal::WorldPlan& plan, sim::MeshScene& scene) {
  if (ceiling.kind != CeilingKind::kModel) return;
  internal::read_model("model://" + ceiling.model, finder, root, missing, scene.warnings);
  plan.add_model(*root.Model(), glm::translate(glm::dmat4(1.0), {0.0, 0.0, ceiling.height_m}));
}

/// Makes the flat ceiling that the options want, if they want one. Returns its height [m].
double close_above(const CeilingOptions& ceiling, sim::MeshScene& scene) {
  if (ceiling.kind == CeilingKind::kModel) return ceiling.height_m;
  if (ceiling.kind == CeilingKind::kHeight) {
    internal::add_flat_ceiling(scene, ceiling.height_m);
    return ceiling.height_m;
  }
  const double height_m = internal::ceiling_height_m(scene);
  if (ceiling.kind == CeilingKind::kWalls && !internal::has_ceiling(scene)) {
    internal::add_flat_ceiling(scene, height_m);
    std::ostringstream note;
    note.precision(3);
    note << ", with a ceiling made at " << height_m << " m";
    scene.source += note.str();
  }
  return height_m;
}

}  // namespace

sim::MeshScene load_gazebo_world(const fs::path& world_file,
                                 const GazeboImportOptions& options,
                                 const TextureReader& textures) {
  sim::MeshScene scene;
  scene.name = world_file.stem().string();
  scene.source = "Gazebo world " + world_file.filename().string();
  const internal::ResourceFinder finder(world_file, options.resource_paths);
  internal::MissingFiles missing;
  sdf::Root root;
  sdf::Root ceiling_root;
  internal::read_world(world_file, finder, root, missing, scene.warnings);

  const sdf::World& world = *root.WorldByIndex(0);
  internal::WorldPlan plan(finder, options, missing, scene);
  for (std::uint64_t i = 0; i < world.ModelCount(); ++i) {
    plan.add_model(*world.ModelByIndex(i), glm::dmat4(1.0));
  }
  plan_ceiling_model(options.ceiling, finder, ceiling_root, missing, plan, scene);
  if (world.ActorCount() > 0) {
    scene.warnings.push_back(std::to_string(world.ActorCount()) +
                             " actors are left out: they move");
  }
  report_missing(missing, world_file, options.on_missing, scene);

  VisualLoader loader(scene, textures, finder);
  for (const PlannedVisual& visual : plan.visuals()) loader.add(visual);
  loader.finish();
  if (scene.triangle_count() == 0) {
    throw core::InputError::expected(
        world_file.string(), "something to see",
        missing.files().empty() ? "nothing" : "nothing but missing files: " + missing.text());
  }
  const double ceiling_m = close_above(options.ceiling, scene);
  set_instance_boxes(scene);
  add_ceiling_lights(scene, ceiling_m, options.light_spacing_m);
  return scene;
}

}  // namespace segsim::worlds
