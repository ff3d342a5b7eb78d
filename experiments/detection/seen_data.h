#pragma once

/// @file
/// What a detector had to do with the images that it is tested on, before it was tested.

#include <filesystem>
#include <string>
#include <vector>

#include "perception/checkpoint/lineage.h"

namespace segsim::experiments::detection {

/// Each text is a line without a full stop.
struct SeenData {
  /// Images of the test that it was trained on, scenes of the test that it was trained on,
  /// images that its threshold was chosen on.
  std::vector<std::string> warnings;
  std::vector<std::string> unknown;  ///< What of that cannot be told, and why.
};

/// @param tested  What the detector is tested on: data_use() of it.
/// @throws core::InputError if the weights are damaged.
[[nodiscard]] SeenData seen_data(const std::filesystem::path& weights,
                                 const perception::DataUse& tested);

/// "flat-3" or "source_rooms/1, seeds 1 to 250".
[[nodiscard]] std::string scene_text(const perception::ImagedScene& scene);

}  // namespace segsim::experiments::detection
