#pragma once

/// @file
/// Masks from hand-made 3-D boxes: a sequence without labels gets per-frame class and instance
/// images by asking in which annotated box each depth pixel lies.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <glm/vec3.hpp>

#include "core/scene_bundle.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction {

/// Box turned about world +z.
struct OrientedBox {
  glm::dvec3 center_m{0.0};  ///< World frame, middle of the box.
  glm::dvec3 size_m{0.0};    ///< Full extents: along yaw, across it, along z.
  double yaw_rad = 0.0;

  [[nodiscard]] bool contains(const glm::dvec3& point_m, double margin_m = 0.0) const;
  [[nodiscard]] double volume_m3() const { return size_m.x * size_m.y * size_m.z; }
  /// Corners of the world-aligned box around it.
  [[nodiscard]] glm::dvec3 world_min_m() const;
  [[nodiscard]] glm::dvec3 world_max_m() const;
};

/// One annotated thing or one slab of the building.
struct AnnotatedBox {
  std::uint16_t id = 0;    ///< Unique in the file.
  std::string class_name;  ///< Lower case, COCO's word where COCO has one.
  std::string name;        ///< "chair 1", "chair 2", ... in file order; slabs: "wall 1".
  OrientedBox box;
  std::vector<OrientedBox>
      parts;               ///< Finer boxes of the same object; used for masks if not empty.
  bool structure = false;  ///< Wall, floor or ceiling slab (stuff).
  bool core = true;        ///< Annotated with care: may serve as a goal.
  std::string note;        ///< As in the file.
};

struct BoxAnnotation {
  std::vector<AnnotatedBox> boxes;             ///< Objects, then slabs; file order.
  std::vector<core::SceneClass> classes;       ///< Ids 1, 2, ... in order of first use.
  std::vector<core::SceneInstance> instances;  ///< The objects, with world-aligned boxes.
};

struct BoxOptions {
  /// Objects take points up to this far outside their box (surface noise of the depth camera).
  double margin_m = 0.02;
};

/// Reads {"objects": [{id, class, center, size, yaw_rad, core, parts}], "planes": {"list":
/// [...]}}.
/// @throws InputError naming the file and the object: not JSON, a missing key, a size <= 0, a
/// number that is not finite, an id outside [1, 65535] or used twice.
[[nodiscard]] BoxAnnotation read_box_annotation(const std::filesystem::path& file);

/// Adds masks to `sequence`: a point on a floor slab is floor; else it belongs to the smallest
/// object box (or part) that holds it, else to the smallest slab, else to nothing. Pixels
/// without depth stay 0. Slabs have a class and no instance.
/// @throws InputError as read_box_annotation, and for frames without depth.
[[nodiscard]] std::unique_ptr<RgbdSequence> with_box_labels(
    std::unique_ptr<RgbdSequence> sequence, const std::filesystem::path& boxes_file,
    const BoxOptions& options = {});

}  // namespace segsim::reconstruction
