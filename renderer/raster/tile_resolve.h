#pragma once

/// @file
/// Resolves the selected surfels of a tile's pixels, block by block: rows of neighbouring
/// pixels are mostly the same, so each distinct row of a block is fetched once.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "renderer/raster/label_resolve.h"
#include "renderer/raster/projection.h"

namespace segsim::renderer::internal {

/// Selected surfels of pixels 0, 1, ... of a tile.
class SelectedSurfels {
 public:
  /// A surfel of a pixel, from a list that is not in the order of pixels.
  struct Entry {
    float weight;
    std::uint32_t slot;
    std::uint32_t pixel;
  };

  void clear();
  void append_pixel(std::span<const WeightedSlot> selected);
  /// Groups `entries` by pixel, keeping their order within a pixel.
  void assign(std::span<const Entry> entries, std::size_t pixel_count);

  [[nodiscard]] std::size_t size() const { return slots_.size(); }
  [[nodiscard]] std::size_t pixel_count() const { return first_.size() - 1; }
  [[nodiscard]] std::span<const WeightedSlot> pixel(std::size_t i) const {
    return {slots_.data() + first_[i], first_[i + 1] - first_[i]};
  }

 private:
  std::vector<WeightedSlot> slots_;
  std::vector<std::size_t> first_{0};
};

/// Where the results go, by pixel; null = not wanted.
struct ResolvedPixels {
  const LabelPlanes* labels = nullptr;
  core::SemanticFeature* semantic_feature = nullptr;
  core::InstanceFeature* instance_feature = nullptr;
};

/// Scratch memory of one thread.
class BlockResolver {
 public:
  /// Pixels whose rows are fetched together.
  static constexpr std::size_t kBlockPixels = 32;

  /// @param shade  Names the surfel and label of a slot.
  /// @return  Rows read: a label for every selected surfel of a pixel, and rows of scores or
  ///     features once for every distinct surfel of a block.
  std::uint64_t resolve(const ResolveJob& job, const SurfelShade* shade,
                        const SelectedSurfels& selected, const ResolvedPixels& out);

 private:
  static constexpr std::size_t kTableSize = 2048;

  /// True the first time in a block. A full table forgets: then a row counts again.
  bool is_new(std::uint32_t surfel);
  std::uint64_t fetch_block(const ResolveJob& job, const SurfelShade* shade,
                            const SelectedSurfels& selected, std::size_t begin,
                            std::size_t end);
  void resolve_pixel(const ResolveJob& job, const SurfelShade* shade,
                     std::span<const WeightedSlot> selected, std::size_t pixel,
                     const ResolvedPixels& out);

  struct Seen {
    std::uint32_t surfel = 0, block = 0;
  };
  std::array<Seen, kTableSize> seen_{};
  std::uint32_t block_ = 0;
  ResolveScratch scratch_;
  std::vector<WeightedSurfel> surfels_;
  std::vector<WeightedLabel> labels_;
};

}  // namespace segsim::renderer::internal
