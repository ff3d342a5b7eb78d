#pragma once

/// @file
/// Everything that will be seen of a world, with its labels, before any mesh is read.

#include <optional>
#include <set>
#include <string>
#include <vector>

#include <glm/mat4x4.hpp>

#include "sim/ground/mesh_scene.h"
#include "worlds/mesh/class_names.h"
#include "worlds/mesh/gazebo/gazebo_options.h"
#include "worlds/mesh/gazebo/internal/visual_materials.h"

namespace segsim::worlds::internal {

struct PlannedVisual {
  const sdf::Geometry* geometry = nullptr;  ///< Of the document; not a missing mesh.
  std::filesystem::path mesh_file;          ///< Of a mesh.
  glm::dmat4 T_world_visual{1.0};
  LabelTable::Ids ids;
  std::optional<PlannedMaterial> material;  ///< None: the mesh's own, or a plain one.
};

/// Walks through models and collects what is seen of them.
class WorldPlan {
 public:
  /// @param finder, missing, options, scene  Outlive it. The scene gets classes, instances and
  /// warnings; `missing` every file that is not there.
  WorldPlan(const ResourceFinder& finder, const GazeboImportOptions& options,
            MissingFiles& missing, sim::MeshScene& scene);

  void add_model(const sdf::Model& model, const glm::dmat4& T_world_parent);

  [[nodiscard]] const std::vector<PlannedVisual>& visuals() const { return visuals_; }

 private:
  /// What an object is called; its ids are given out when something of it is seen.
  struct Label {
    std::string name;
    ModelClass model_class;
    std::optional<LabelTable::Ids> ids;
  };

  [[nodiscard]] ModelClass class_of(const std::string& name) const;
  [[nodiscard]] ModelClass class_of_included(const sdf::Model& model) const;
  [[nodiscard]] glm::dmat4 resolve(const sdf::SemanticPose& semantic_pose);
  void add_below(const sdf::Model& model, const glm::dmat4& T_world_parent, Label& label);
  void add_nested(const sdf::Model& model, const glm::dmat4& T_world_parent, Label& outer);
  void add_link(const sdf::Link& link, const glm::dmat4& T_world_link, Label& label);
  void add_collisions(const sdf::Link& link, const glm::dmat4& T_world_link, Label& label);
  void add_visual(const sdf::Visual& visual, PlannedVisual planned, Label& label);
  /// File of a mesh, with its textures looked for; nullopt if it is missing.
  [[nodiscard]] std::optional<std::filesystem::path> mesh_file(const sdf::Mesh& mesh,
                                                               const std::string& user);

  const ResourceFinder& finder_;
  const GazeboImportOptions& options_;
  MissingFiles& missing_;
  sim::MeshScene& scene_;
  VisualMaterials materials_;
  LabelTable labels_;
  std::vector<PlannedVisual> visuals_;
  std::set<std::filesystem::path> checked_meshes_;
  std::set<std::string> far_;  ///< Models that are left out because of where they are.
};

}  // namespace segsim::worlds::internal
