#pragma once

/// @file
/// From the selected surfels of a pixel to its label, where surfels have one label each.

#include <cstddef>
#include <cstdint>
#include <span>

#include "renderer/raster/projection.h"

namespace segsim::renderer::internal {

/// A surfel's share alpha * T in a pixel, and its label semantic | instance << 16.
struct WeightedLabel {
  float weight;
  std::uint32_t label;
};

struct PixelLabel {
  std::uint16_t semantic = 0, instance = 0;
  float confidence = 0.0F;           ///< Of `semantic`, [0, 1]; of a vote: its share.
  float instance_confidence = 0.0F;  ///< Of `instance`, [0, 1].
};

/// Class and instance with the largest summed weight, each on its own; ties go to the lower
/// id. O(n d) for n surfels of d labels.
/// @param candidates  Weights > 0.
[[nodiscard]] PixelLabel vote(std::span<const WeightedLabel> candidates);

/// Keys of a row of pixels: rank k of pixel i is at first[k * rank_stride + i].
struct KeyRow {
  const std::uint32_t* first;
  std::size_t rank_stride;
  int key_count;    ///< Ranks in use, >= 1.
  int pixel_count;  ///< A multiple of 16.
};

/// Where the labels of pixels 0, 1, ... go: PixelLabel by fields.
struct LabelPlanes {
  std::uint16_t* semantic;
  std::uint16_t* instance;
  float* confidence;
  float* instance_confidence;

  void set(std::size_t pixel, const PixelLabel& label) const {
    semantic[pixel] = label.semantic;
    instance[pixel] = label.instance;
    confidence[pixel] = label.confidence;
    instance_confidence[pixel] = label.instance_confidence;
  }
};

/// vote() of every pixel of a row; pixels without keys get an empty label.
/// @param slots  Slot of a key's list position.
/// @param out    pixel_count labels.
/// @return  Labels read.
std::uint64_t vote_row(const KeyRow& keys, const std::uint32_t* slots,
                       const SurfelShade* shade, const LabelPlanes& out);

}  // namespace segsim::renderer::internal
