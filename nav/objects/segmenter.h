#pragma once

/// @file
/// From a box to the pixels of its object. VLFM asks MobileSAM; the default here needs no
/// weights.

#include <memory>

#include "core/stages.h"

namespace segsim::nav {

class Segmenter {
 public:
  virtual ~Segmenter() = default;
  /// 1 = object; as large as the depth image.
  [[nodiscard]] virtual core::Image<std::uint8_t> segment(const core::Observation& observation,
                                                          const core::BoxPx& box) = 0;
};

/// Box and depth: the pixels of the box in the nearest depth layer that holds a quarter of its
/// measured pixels (layers are separated by 0.3 m without any). A box without depth is all
/// mask.
[[nodiscard]] std::unique_ptr<Segmenter> make_depth_segmenter();

}  // namespace segsim::nav
