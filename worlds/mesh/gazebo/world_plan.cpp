#include "worlds/mesh/gazebo/internal/world_plan.h"

#include <map>
#include <utility>

#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/quaternion.hpp>
#include <ignition/math/Pose3.hh>

#include "worlds/mesh/internal/mesh_parts.h"

namespace segsim::worlds::internal {
namespace {

namespace fs = std::filesystem;

/// Visuals that are as good as invisible; Gazebo has them for collision shapes and sensors.
constexpr float kInvisible = 0.99F;

/// Farther from the origin, nothing is part of a place: such models have fallen through the
/// floor before somebody saved the world.
constexpr double kFarthest_m = 10'000.0;

glm::dmat4 matrix(const ignition::math::Pose3d& pose) {
  const glm::dquat rotation(pose.Rot().W(), pose.Rot().X(), pose.Rot().Y(), pose.Rot().Z());
  return glm::translate(glm::dmat4(1.0), {pose.X(), pose.Y(), pose.Z()}) *
         glm::mat4_cast(rotation);
}

bool has_visuals(const sdf::Model& model) {
  for (std::uint64_t i = 0; i < model.LinkCount(); ++i) {
    if (model.LinkByIndex(i)->VisualCount() > 0) return true;
  }
  return false;
}

/// A model around one included model: both are one object.
bool only_wraps(const sdf::Model& model) {
  return model.ModelCount() == 1 && !has_visuals(model);
}

/// "desk" of "model://desk" and of "model://package/models/desk/".
std::string last_part(std::string uri) {
  while (uri.ends_with('/')) uri.pop_back();
  return uri.substr(uri.find_last_of('/') + 1);
}

}  // namespace

WorldPlan::WorldPlan(const ResourceFinder& finder, const GazeboImportOptions& options,
                     MissingFiles& missing, sim::MeshScene& scene)
    : finder_(finder),
      options_(options),
      missing_(missing),
      scene_(scene),
      materials_(finder, missing),
      labels_(scene) {}

ModelClass WorldPlan::class_of(const std::string& name) const {
  if (options_.corrected_class) {
    std::string words;
    for (const std::string& word : words_of_name(name)) {
      words += (words.empty() ? "" : " ") + word;
    }
    if (const auto corrected = options_.corrected_class(words)) return class_named(*corrected);
  }
  return class_of_model(name);
}

/// By the model's own name, else by that of what it includes.
ModelClass WorldPlan::class_of_included(const sdf::Model& model) const {
  ModelClass found = class_of(model.Name());
  if (found.known) return found;
  if (const sdf::ElementPtr include = model.Element()->GetIncludeElement()) {
    found = class_of(last_part(include->Get<std::string>("uri")));
  }
  return !found.known && only_wraps(model) ? class_of_included(*model.ModelByIndex(0)) : found;
}

glm::dmat4 WorldPlan::resolve(const sdf::SemanticPose& semantic_pose) {
  ignition::math::Pose3d pose;
  for (const sdf::Error& error : semantic_pose.Resolve(pose)) {
    scene_.warnings.push_back("pose: " + error.Message());
  }
  return matrix(pose);
}

void WorldPlan::add_model(const sdf::Model& model, const glm::dmat4& T_world_parent) {
  Label label{model.Name(), class_of_included(model), {}};
  add_below(model, T_world_parent, label);
}

void WorldPlan::add_below(const sdf::Model& model, const glm::dmat4& T_world_parent,
                          Label& label) {
  const glm::dmat4 T_world_model = T_world_parent * resolve(model.SemanticPose());
  for (std::uint64_t i = 0; i < model.LinkCount(); ++i) {
    const sdf::Link& link = *model.LinkByIndex(i);
    add_link(link, T_world_model * resolve(link.SemanticPose()), label);
  }
  const bool one_object = only_wraps(model);
  for (std::uint64_t i = 0; i < model.ModelCount(); ++i) {
    const sdf::Model& nested = *model.ModelByIndex(i);
    if (one_object) {
      add_below(nested, T_world_model, label);
    } else {
      add_nested(nested, T_world_model, label);
    }
  }
}

void WorldPlan::add_nested(const sdf::Model& model, const glm::dmat4& T_world_parent,
                           Label& outer) {
  const ModelClass own = class_of_included(model);
  const bool is_part =
      own.known ? outer.ids && own.name == outer.model_class.name : outer.model_class.known;
  if (is_part) return add_below(model, T_world_parent, outer);
  Label label{outer.name + "::" + model.Name(), own, {}};
  add_below(model, T_world_parent, label);
}

void WorldPlan::add_link(const sdf::Link& link, const glm::dmat4& T_world_link, Label& label) {
  // Parts of a building, or of something without a class, may say what they are.
  const bool refine = !label.model_class.known || !label.model_class.thing;
  std::map<std::string, Label> parts;  // By class.
  bool mesh_is_missing = false;
  for (std::uint64_t i = 0; i < link.VisualCount(); ++i) {
    const sdf::Visual& visual = *link.VisualByIndex(i);
    if (visual.Geom() == nullptr || visual.Transparency() >= kInvisible) continue;
    PlannedVisual planned;
    planned.geometry = visual.Geom();
    planned.T_world_visual = T_world_link * resolve(visual.SemanticPose());
    std::string mesh_name;
    if (const sdf::Mesh* mesh = visual.Geom()->MeshShape()) {
      const auto file = mesh_file(*mesh, label.name);
      mesh_is_missing |= !file;
      if (!file) continue;
      planned.mesh_file = *file;
      mesh_name = fs::path(last_part(mesh->Uri())).stem().string();
    }
    Label* owner = &label;
    if (refine) {
      for (const std::string& name : {visual.Name(), link.Name(), mesh_name}) {
        const ModelClass found = class_of(name);
        if (!found.known) continue;
        if (found.name == label.model_class.name) break;
        owner =
            &parts.try_emplace(found.name, Label{label.name + "::" + link.Name(), found, {}})
                 .first->second;
        break;
      }
    }
    add_visual(visual, std::move(planned), *owner);
  }
  if (mesh_is_missing && options_.on_missing == OnMissing::kCollision) {
    add_collisions(link, T_world_link, label);
  }
}

void WorldPlan::add_visual(const sdf::Visual& visual, PlannedVisual planned, Label& label) {
  const glm::dvec3 position(planned.T_world_visual[3]);
  if (!(glm::length(position) < kFarthest_m)) {
    if (far_.insert(label.name).second) {
      scene_.warnings.push_back("model " + label.name +
                                " is left out: it lies more than 10 km from the origin");
    }
    return;
  }
  if (!label.ids) label.ids = labels_.add(label.name, label.model_class);
  planned.ids = *label.ids;
  planned.material = materials_.plan(visual, label.name);
  visuals_.push_back(std::move(planned));
}

void WorldPlan::add_collisions(const sdf::Link& link, const glm::dmat4& T_world_link,
                               Label& label) {
  for (std::uint64_t i = 0; i < link.CollisionCount(); ++i) {
    const sdf::Collision& collision = *link.CollisionByIndex(i);
    if (collision.Geom() == nullptr) continue;
    PlannedVisual planned;
    planned.geometry = collision.Geom();
    if (const sdf::Mesh* mesh = collision.Geom()->MeshShape()) {
      const auto file = mesh_file(*mesh, label.name);
      if (!file) continue;
      planned.mesh_file = *file;
    }
    planned.T_world_visual = T_world_link * resolve(collision.SemanticPose());
    if (!label.ids) label.ids = labels_.add(label.name, label.model_class);
    planned.ids = *label.ids;
    visuals_.push_back(std::move(planned));
  }
}

std::optional<fs::path> WorldPlan::mesh_file(const sdf::Mesh& mesh, const std::string& user) {
  auto file = finder_.find(mesh.Uri(), fs::path(mesh.FilePath()).parent_path());
  if (!file || !fs::is_regular_file(*file)) {
    missing_.add(MissingKind::kMesh, mesh.Uri(), user);
    return std::nullopt;
  }
  if (checked_meshes_.insert(*file).second) {
    const auto find_uri = [this](const std::string& uri, const fs::path& folder) {
      return finder_.find(uri, folder);
    };
    for (const std::string& name : texture_names(*file)) {
      if (texture_files(name, file->parent_path(), find_uri).empty()) {
        missing_.add(MissingKind::kMeshTexture, name, file->filename().string());
      }
    }
  }
  return file;
}

}  // namespace segsim::worlds::internal
