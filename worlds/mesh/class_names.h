#pragma once

/// @file
/// From the names that modellers give to their objects to the class names of this project.

#include <cstdint>
#include <string>
#include <string_view>

#include "sim/ground/mesh_scene.h"

namespace segsim::worlds {

struct ModelClass {
  std::string_view name;  ///< Lower case, COCO's word where COCO has one.
  bool thing = true;
  bool known = true;  ///< False: no rule fitted and the class is "object".
};

/// Class of a model by its name, for example "ChairA_01_003" -> chair, "FloorB_01_001" ->
/// floor. Capitals and a vendor's prefix do not matter. The longest rule that begins the name
/// wins, else the longest rule that occurs in it, else "object".
[[nodiscard]] ModelClass class_of_model(std::string_view model_name);

/// Gives out class and instance ids in order of first appearance and writes them into a scene.
class LabelTable {
 public:
  struct Ids {
    std::uint16_t class_id = 0, instance_id = 0;
  };

  /// @param scene  Receives classes, instances and warnings; must outlive the table.
  explicit LabelTable(sim::MeshScene& scene) : scene_(scene) {}

  /// Ids of a new object. Stuff has instance 0. A name without a class is warned of.
  /// @throws InputError when there are more than 65,535 instances.
  Ids add(const std::string& model_name);

 private:
  std::uint16_t class_id(const ModelClass& model_class);

  sim::MeshScene& scene_;
};

/// Sets the box of every instance from the vertices of its meshes.
void set_instance_boxes(sim::MeshScene& scene);

}  // namespace segsim::worlds
