#pragma once

/// @file
/// Train and validation sets that share no view: by scene, then by viewpoint.

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/scenes/view_sampler.h"
#include "perception/data/dataset.h"

namespace segsim::experiments::detection {

struct ViewSplitOptions {
  double val_share = 0.2;  ///< Of each training scene's views, [0, 1).
  scenes::ViewDistance apart{
      0.5, 0.523598776};                ///< A validation view is unlike every training view.
  std::vector<std::string> val_scenes;  ///< Wholly held out.
  std::uint64_t seed = 1;
};

struct ViewSplit {
  perception::CocoDataset train, val_views, val_scenes;
  int dropped = 0;  ///< Views in no set: too much like a validation view to train on.
};

/// Image ids and order stay. Views without a place (`LabeledImage::view`) cannot be told apart
/// from their neighbours.
/// @throws core::InputError if an image lacks scene or view, for a validation scene that no
/// image shows, or if nothing is left to train on.
[[nodiscard]] ViewSplit split_views(const perception::CocoDataset& dataset,
                                    const ViewSplitOptions& options);

}  // namespace segsim::experiments::detection
