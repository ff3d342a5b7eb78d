#pragma once

/// @file
/// Labels of a panoptic field where all surfels that a pixel selected say the same: nearly
/// everywhere. Other pixels are left to resolve_panoptic(), which gives the same labels, to
/// the bit, for those that are decided here.

#include <array>
#include <cstdint>
#include <vector>

#include "renderer/raster/label_vote.h"
#include "renderer/raster/projection.h"
#include "renderer/scene/panoptic_field.h"

namespace segsim::renderer::internal {

/// What the rows of every surfel say first, by index in the cloud.
class FieldTops {
 public:
  /// Of a surfel of which a row that matters is empty.
  static constexpr std::uint32_t kUndecided = 0xFFFFFFFF;
  /// The instance of a class that is no thing, whatever the row says.
  static constexpr std::uint32_t kNoThing = 0xFFFF;

  /// As much as is read of a surfel: a quarter of a cache line.
  struct Scores {
    float class_excess, instance_excess, instance_base, unused;
  };

  FieldTops() = default;
  /// @param field  Must outlive this object.
  explicit FieldTops(const PanopticField& field);

  /// Index of the class | index of the instance << 16, indices of the field's tables.
  [[nodiscard]] const std::vector<std::uint32_t>& labels() const { return labels_; }
  [[nodiscard]] const std::vector<Scores>& scores() const { return scores_; }
  [[nodiscard]] const PanopticField& field() const { return *field_; }

 private:
  const PanopticField* field_ = nullptr;
  std::vector<std::uint32_t> labels_;
  std::vector<Scores> scores_;
};

/// Pixels of a tile: bit p % 64 of word p / 64.
using PixelSet = std::array<std::uint64_t, kTileSizePx * kTileSizePx / 64>;

/// Labels of the pixels whose surfels agree.
/// @param keys   A tile's, in rows of pixels.
/// @param slots  Slot of a key's list position.
/// @param shade  Its labels are those of `tops`.
/// @param out    Of the other pixels it receives anything.
/// @param left   Receives the other pixels.
/// @return  Surfels read.
std::uint64_t vote_field(const KeyRow& keys, const std::uint32_t* slots,
                         const SurfelShade* shade, const FieldTops& tops,
                         const LabelPlanes& out, PixelSet& left);

}  // namespace segsim::renderer::internal
