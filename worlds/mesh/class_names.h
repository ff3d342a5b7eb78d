#pragma once

/// @file
/// From the names that modellers give to their objects to the class names of this project.

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "sim/ground/mesh_scene.h"

namespace segsim::worlds {

struct ModelClass {
  std::string name;  ///< Lower case, COCO's word where COCO has one.
  bool thing = true;
  bool known = true;  ///< False: no rule fitted and the class is "unknown".
};

/// The class under a name, for corrections by people: wall, partition, floor, ceiling and
/// carpet are stuff, everything else is a thing.
[[nodiscard]] ModelClass class_named(const std::string& name);

/// The words of a name in lower case, as modellers write them: "TVStand_01_003" -> tv, stand.
/// Numbers and single letters only count copies and variants and are left out, as is "clone".
[[nodiscard]] std::vector<std::string> words_of_name(std::string_view name);

/// Class of a model by its name, for example "ChairA_01_003" -> chair, "FloorB_01_001" ->
/// floor. A rule is a word or several in a row; plurals fit, parts of words do not
/// ("bathroom" is no bath). The rule that ends last in the name wins, and of those the
/// longest: an "office_desk_lamp" is a lamp. Without a rule the class is "unknown".
[[nodiscard]] ModelClass class_of_model(std::string_view model_name);

/// Gives out class and instance ids in order of first appearance and writes them into a scene.
class LabelTable {
 public:
  struct Ids {
    std::uint16_t class_id = 0, instance_id = 0;
  };

  /// @param scene  Receives classes, instances and warnings; must outlive the table.
  explicit LabelTable(sim::MeshScene& scene) : scene_(scene) {}

  /// Ids of a new object. Stuff has instance 0. A name without a class is warned of, each
  /// wording once.
  /// @throws InputError when there are more than 65,535 instances.
  Ids add(const std::string& model_name);
  /// The same with a class that somebody else has found.
  Ids add(const std::string& model_name, const ModelClass& model_class);

 private:
  std::uint16_t class_id(const ModelClass& model_class);

  /// The scene's entry for the words of a name, made if there is none.
  sim::ClassGuess& guess(const std::string& model_name, std::uint16_t class_id);

  sim::MeshScene& scene_;
};

/// Sets the box of every instance from the vertices of its meshes.
void set_instance_boxes(sim::MeshScene& scene);

}  // namespace segsim::worlds
