#pragma once

#include <vector>

#include "perception/data/labeled_box.h"

namespace segsim::perception {

/// Pictures of one forward pass of training.
struct Batch {
  std::vector<float> pixels;  ///< [batch, 3, input_px, input_px], RGB in [0, 1].
  std::vector<std::vector<LabeledBox>> truth;  ///< Boxes in pixels of the square.
};

}  // namespace segsim::perception
