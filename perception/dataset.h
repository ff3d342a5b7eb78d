#pragma once

/// @file
/// Labelled images on disk: a COCO "instances" JSON file beside its images
/// (https://cocodataset.org/#format-data). Beyond COCO, an annotation may have
/// "visible_fraction" (number in [0, 1]), "ignore", "truncated", "occluded" (0 or 1),
/// "distance_m" (number >= 0) and "instance_id" (integer >= 1); an image "scene" (text) and
/// "view" ([x m, y m, yaw rad] of the robot in the world frame). Readers of plain COCO skip
/// them.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/frames.h"
#include "perception/labeled_box.h"

namespace segsim::perception {

struct LabeledImage {
  std::int64_t id = 0;  ///< COCO image id, unique.
  std::string file;     ///< Relative to the folder of the JSON file, with '/'.
  int width_px = 0, height_px = 0;
  std::vector<LabeledBox> boxes;
  std::string scene{};                ///< Where it was taken; empty = unknown.
  std::optional<core::Pose2> view{};  ///< Where the robot stood.
};

struct CocoDataset {
  std::filesystem::path folder;          ///< Of the JSON file.
  std::vector<std::string> class_names;  ///< In ascending order of category id.
  std::vector<LabeledImage> images;      ///< In the file's order.
  std::string sha256;                    ///< Of the JSON file; empty before it is written.

  [[nodiscard]] std::filesystem::path image_file(const LabeledImage& image) const {
    return folder / image.file;
  }
};

/// Reads a data set; the image files are not opened.
/// @throws core::InputError naming file and key: a missing or wrong value, an unknown image or
///         category, a double id, an absolute image path, a box without area or off the image.
[[nodiscard]] CocoDataset read_coco(const std::filesystem::path& json_file);

/// Writes `dataset` (its `folder` and `sha256` are not used) with categories 1, 2, ... and
/// annotations numbered in order.
void write_coco(const std::filesystem::path& json_file, const CocoDataset& dataset);

}  // namespace segsim::perception
