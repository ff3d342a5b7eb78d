#pragma once

/// @file
/// The scenes of `segsim table 1`, by name, by folder, or from a file:
///
///     schema: segsim.table1/1
///     scenes:
///       - name: scene0087_02
///         data: ScanNet                    # names the group of scenes that is averaged
///         source: {type: rgbd, folder: "${data}/scannet/scene0087_02", frame_step: 3}
///         label_map: ${spec}/../label_maps/scannet_0087_02.yaml     # optional
///         masks: ${data}/scannet/scene0087_02/masks  # optional: of a segmenter
///         shrink: 2                                  # optional: n x n pixels become one
///
/// `source` is that of an experiment (spec.h).

#include <filesystem>
#include <string>
#include <vector>

#include "experiments/specs/spec.h"

namespace segsim::experiments::panoptic {

struct PanopticScene {
  std::string name;   ///< Unique; names a folder.
  std::string title;  ///< For tables.
  std::string data;   ///< Data set; scenes of one are averaged.
  specs::SourceSpec source;
  std::filesystem::path label_map, masks;  ///< Empty: none.
  int shrink = 1;

  /// IoU above which PanopticRecon++'s scripts match: 0.1 for ScanNet, 0.3 for others.
  [[nodiscard]] double zju_min_iou() const { return data == "ScanNet" ? 0.1 : 0.3; }
  /// The file or folder that must be there; empty for procedural flats.
  [[nodiscard]] std::filesystem::path needs() const;
};

/// A scene that the table should have and has not.
struct MissingScene {
  std::string title, why;
};

struct PanopticScenes {
  std::vector<PanopticScene> scenes;
  std::vector<MissingScene> missing;
};

/// @param text  Names separated by commas: "flat-N" (procedural flat of seed N), "breakroom",
///     "house" (both below `data`), or folders of recordings; or one YAML file; empty: flat-3,
///     flat-8 and what `data` has. Scenes of a file whose data is not there, and data sets
///     that need a licence, are listed as missing.
/// @param data  Folder of the data, empty: none.
/// @throws core::InputError for a name that is unknown or comes twice, a named scene without
///     data, a broken file, or if no scene is left.
[[nodiscard]] PanopticScenes panoptic_scenes(const std::string& text,
                                             const std::filesystem::path& data);

}  // namespace segsim::experiments::panoptic
