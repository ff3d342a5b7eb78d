#pragma once

/// @file
/// Labelled images on disk: a COCO "instances" JSON file beside its images
/// (https://cocodataset.org/#format-data). Beyond COCO, an annotation may have
/// "visible_fraction" (number in [0, 1]), "ignore", "truncated", "occluded" (0 or 1),
/// "distance_m" (number >= 0) and "instance_id" (integer >= 1); an image "scene" (text) and
/// "view" ([x m, y m, yaw rad] of the robot in the world frame); the file itself may have
/// "segsim_scenes", a list of ImagedScene. Readers of plain COCO skip them.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <glm/vec2.hpp>

#include "core/frames.h"
#include "perception/data/labeled_box.h"

namespace segsim::perception {

/// A place that images show: a scene bundle, or places that a generator makes from seeds.
struct ImagedScene {
  std::string name{};  ///< Of a bundle's manifest; empty for a generator's places.
  /// Of the bundle's surfels, which are all that the images show. (The hash of scene.yaml
  /// would change with the version of the program that wrote it, and with the scene's name.)
  std::string surfels_sha256{};
  std::string generator{};  ///< With its version: "source_rooms/1"; empty for a bundle.
  std::uint64_t first_seed = 0, last_seed = 0;  ///< Of the generator, both included.

  bool operator==(const ImagedScene&) const = default;
};

/// Whether both show the same place: equal surfels, or a seed of one generator in common.
[[nodiscard]] bool is_same_place(const ImagedScene& a, const ImagedScene& b);

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
  /// All places that the images show; none if that is not known.
  std::optional<std::vector<ImagedScene>> scenes{};

  [[nodiscard]] std::filesystem::path image_file(const LabeledImage& image) const {
    return folder / image.file;
  }
};

/// Reads a data set; the image files are not opened.
/// @throws core::InputError naming file and key: a missing or wrong value, an unknown image or
///         category, a double id, an absolute image path, a box without area or off the image,
///         a damaged list of scenes.
[[nodiscard]] CocoDataset read_coco(const std::filesystem::path& json_file);

/// Writes `dataset` (its `folder` and `sha256` are not used) with categories 1, 2, ... and
/// annotations numbered in order.
void write_coco(const std::filesystem::path& json_file, const CocoDataset& dataset);

/// Counts views of a scene that were taken within `radius_m` of one of the places.
/// @param showing  Only views with a box of this class; empty: all.
[[nodiscard]] int views_near(const CocoDataset& dataset, const std::string& scene,
                             const std::vector<glm::dvec2>& places_m, double radius_m,
                             const std::string& showing = {});

}  // namespace segsim::perception
