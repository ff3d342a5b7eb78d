#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/config.h"
#include "core/scene_bundle.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction {

/// labels.yaml beside the frames of a capture: what the ids in the masks mean, and the
/// conventions of the other files.
///
///     schema: segsim.labels
///     version: 1
///     pixel_center: 0.5      # of the intrinsics: 0.5 or 0
///     up: z                  # axis of the poses' world: z or y
///     source: "in words"
///     classes:
///       - {id: 1, name: chair, thing: true}
///     instances:
///       - {id: 1, class: 1, name: ChairA_01_003}    # class: id or name
///       - {id: 2, class: 1, name: stack, iscrowd: true}    # many chairs, nobody told apart
struct SequenceLabels {
  double pixel_center = 0.5;
  UpAxis up = UpAxis::kZ;
  std::string source;
  std::vector<core::SceneClass> classes;
  std::vector<core::SceneInstance> instances;  ///< Without boxes.
  std::vector<std::uint16_t> crowds;           ///< Instance ids with `iscrowd`, ascending.
};

/// @throws InputError naming file, line and key: unknown keys, another schema or version, ids
/// outside [1, 65535] or used twice, an instance of an unknown class, a crowd of stuff.
[[nodiscard]] SequenceLabels read_sequence_labels(const std::filesystem::path& file);

/// `schema: name` and `version: number` of a file.
/// @throws InputError if it is another.
void expect_schema(const core::ConfigNode& root, const std::string& name,
                   std::int64_t version);

/// The list under `classes`, ascending by id: {id, name, thing, evaluated}. Unknown keys are
/// refused.
[[nodiscard]] std::vector<core::SceneClass> read_scene_classes(const core::ConfigNode& root);

}  // namespace segsim::reconstruction
