#pragma once

/// @file
/// What weights have learnt from, as their own file says it: the list "data" in the "training"
/// object of its header (weights_file.h), oldest first, with all that was inherited from the
/// weights that a fine-tuning began with.
///
///     [{"what": "foreign", "file": "n.pt", "sha256": "...", "scenes": "unknown"},
///      {"what": "train", "images": 400, "labels_sha256": "...", "views_sha256": "...",
///       "image_hashes": "...", "scenes": [{"name": "flat-3", "surfels_sha256": "..."}]},
///      {"what": "validation", ...}]
///
/// Scenes are those of internal/scene_json.h. Images are known by their decoded pixels, so
/// that another compression of a picture is the same picture.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "perception/checkpoint/weights_file.h"
#include "perception/data/dataset.h"

namespace segsim::perception {

enum class DataPurpose : std::uint8_t {
  kTrain,
  kMix,         ///< Mixed in against forgetting.
  kValidation,  ///< The score threshold, or the step that is kept, was chosen on it.
  kForeign      ///< Weights whose file does not say what they were trained on.
};
[[nodiscard]] const char* to_string(DataPurpose purpose);

/// One data set that weights depend on.
struct DataUse {
  DataPurpose purpose = DataPurpose::kTrain;
  int images = 0;
  std::string labels_sha256;   ///< Of the COCO file. kForeign: of the file of weights.
  std::string views_sha256{};  ///< Of all images' hashes in ascending order; empty if unknown.
  /// The first 48 bits of the SHA-256 of each image's size and pixels, ascending; empty if
  /// they are not known.
  std::vector<std::uint64_t> image_hashes{};
  /// All places that the images show; none if that is not known.
  std::optional<std::vector<ImagedScene>> scenes{};
  std::string file{};  ///< kForeign: its name.

  bool operator==(const DataUse&) const = default;
};

/// Hashes every image of `dataset`. Its places count as known if it lists them, and each
/// image that names one names one of these.
/// @throws core::InputError if an image cannot be read.
[[nodiscard]] DataUse data_use(DataPurpose purpose, const CocoDataset& dataset);

/// The record in `training` (DetectorWeights::training); none if there is none.
/// @param place  Stands before what is wrong.
/// @throws core::InputError if it is damaged.
[[nodiscard]] std::optional<std::vector<DataUse>> recorded_data(const std::string& training,
                                                                const std::string& place);

/// What `weights` depend on; a single foreign use if their file `file` has no record.
[[nodiscard]] std::vector<DataUse> data_of(const DetectorWeights& weights,
                                           const std::filesystem::path& file);

/// One foreign use: weights or a model of others.
[[nodiscard]] DataUse foreign_data(const std::string& name, const std::string& sha256);

/// `training` with the record `data`, in which equal entries stand once.
[[nodiscard]] std::string with_data(const std::string& training,
                                    const std::vector<DataUse>& data);

/// Adds a data set to the record of weights that were read from `file`.
void add_data(DetectorWeights& weights, const std::filesystem::path& file, DataUse use);

/// Whether an image of that hash is in the data set, as far as it is known.
[[nodiscard]] bool has_image(const DataUse& use, std::uint64_t hash);

}  // namespace segsim::perception
