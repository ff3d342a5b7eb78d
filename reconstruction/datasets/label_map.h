#pragma once

/// @file
/// From the ids in a data set's label images to the classes of a scene.
///
///     schema: segsim.label_map
///     version: 1
///     classes:
///       - {id: 1, name: floor}
///       - {id: 2, name: chair, thing: true}
///       - {id: 6, name: telephone, evaluated: false}
///     ids:                       # without it: source ids are class ids
///       - {from: [2, 23], to: 2}
///       - {from: [3], to: 1}

#include <cstdint>
#include <filesystem>
#include <map>
#include <vector>

#include "core/scene_bundle.h"

namespace segsim::reconstruction {

struct LabelMap {
  std::vector<core::SceneClass> classes;     ///< Ascending by id.
  std::vector<std::uint16_t> not_evaluated;  ///< Class ids that metrics treat as void.
  /// Source id -> class id; ids that are missing are void. Empty: the identity.
  std::map<std::uint16_t, std::uint16_t> ids;

  /// Class of a source id; 0 if it has none.
  [[nodiscard]] std::uint16_t class_of(std::uint16_t source_id) const;
  [[nodiscard]] std::vector<core::SceneClass> evaluated() const;
};

/// @throws InputError naming file, line and key.
[[nodiscard]] LabelMap read_label_map(const std::filesystem::path& file);

/// The 20 NYU40 classes that ScanNet evaluates, from `scannetv2-labels.combined.tsv` (or the
/// older scannet-labels.combined.tsv): raw id -> column "nyu40id", found by the header's
/// names. Wall and floor are stuff.
/// @throws InputError naming file and line: a column is missing, a number is none.
[[nodiscard]] LabelMap read_scannet_table(const std::filesystem::path& file);

/// Replica's habitat/info_semantic.json: "classes": [{"id", "name"}]. Wall, floor and ceiling
/// are stuff.
[[nodiscard]] LabelMap read_replica_classes(const std::filesystem::path& file);

}  // namespace segsim::reconstruction
