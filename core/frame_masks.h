#pragma once

/// @file
/// What a 2-D segmenter says about one view. Made by a model (perception/) or by noise on
/// exact labels (sim/), stored in files and learned from (renderer/).

#include <cstdint>
#include <vector>

#include "core/image.h"
#include "core/stages.h"

namespace segsim::core {

/// One mask of a thing, or all masks of one stuff class.
struct MaskSegment {
  std::uint16_t id = 0;  ///< Of this view alone; 0 for stuff.
  std::uint16_t class_id = 0;
  float score = 0.0F;  ///< Confidence, [0, 1].
  int area_px = 0;
  BoxPx box;  ///< Around its pixels, half-open.
  /// COCO's `iscrowd`: many objects of the class that nobody told apart. Of annotations alone.
  bool crowd = false;
};

/// Images of equal size. Ids have no meaning beyond the view: the same object is called
/// differently in the next one.
struct FrameMasks {
  Image<std::uint16_t> semantic;      ///< Class id, 0 = void: nothing was said.
  Image<std::uint16_t> instance;      ///< Id of a thing's mask, 0 = stuff or void.
  Image<std::uint8_t> confidence;     ///< Score * 255 of the mask at the pixel; 0 on void.
  std::vector<MaskSegment> segments;  ///< Ascending by (id, class id).
};

/// The segments that the three images show, ascending by (id, class id). Their score is the
/// mean confidence of their pixels.
[[nodiscard]] std::vector<MaskSegment> segments_of(const FrameMasks& masks);

}  // namespace segsim::core
