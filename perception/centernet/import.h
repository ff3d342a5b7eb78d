#pragma once

/// @file
/// The published MobileNetV3-CenterNet, a TensorFlow.js model (centernet.json and the file
/// with its weights beside it) -> a weights file of this program (weights_file.h), by name and
/// shape. docs/centernet.md says where the model comes from.
///
/// Only the weights are read: the graph is that of internal/centernet/network.h, and whatever
/// else the file says is left alone. The published input is 0 ... 255; ours is [0, 1], so the
/// first layer's weights are multiplied by 255.

#include <filesystem>
#include <string>
#include <vector>

#include "perception/checkpoint/tensor_file.h"
#include "perception/checkpoint/weights_file.h"

namespace segsim::perception::centernet {

struct ImportOptions {
  int input_px = 320;             ///< Side of the square input.
  float score_threshold = 0.25F;  ///< Stored with the weights.
  /// As many as the file has; empty: COCO's for 80, else "class 0", "class 1", ...
  std::vector<std::string> class_names{};
};

/// Whether the tensors are those of this network, by the name of its first layer.
[[nodiscard]] bool is_published(const TensorFile& file);

/// @param source  That `file` was read from.
/// @throws core::InputError in one line with the place for a tensor that is missing or has
///     another shape, values that are not finite, or class names of another number.
[[nodiscard]] DetectorWeights read_published_weights(const TensorFile& file,
                                                     const std::filesystem::path& source,
                                                     const ImportOptions& options = {});

/// Name in the published file, and the order of its axes in ours.
struct PublishedName {
  std::string ours, published;
  std::vector<int> axes;  ///< Ours <- published; empty for a vector.
};
/// Of all tensors of the network.
[[nodiscard]] std::vector<PublishedName> published_names();

}  // namespace segsim::perception::centernet
