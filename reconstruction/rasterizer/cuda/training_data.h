#pragma once

/// @file
/// What the training kernels share with the host code that launches them.

#include <cstddef>
#include <cstdint>

#include "reconstruction/rasterizer/surfel_adjoint.h"
#include "reconstruction/rasterizer/surfel_parameters.h"
#include "renderer/cuda/device_data.h"
#include "renderer/cuda/device_memory.h"

namespace segsim::reconstruction::cuda {

/// In whole words of 16 bytes, as copies to shared memory want it.
struct alignas(16) DrawnRecord {
  DrawnSurfel<float> surfel;
};
inline constexpr int kRecordWords = sizeof(DrawnRecord) / 16;
static_assert(sizeof(DrawnRecord) == 80 && sizeof(DrawnRecord) == sizeof(DrawnSurfel<float>));

/// Pixels [x_lo, x_hi] x [y_lo, y_hi] that a surfel can reach.
struct alignas(8) SurfelPixels {
  std::uint16_t x_lo, x_hi, y_lo, y_hi;
};

/// Values of LocalGradient that every pixel contributes to. `reach` is kept apart: it is
/// rarely not 0.
inline constexpr int kSums = 16;
static_assert(kSums + 1 == kLocalGradientSize);

/// Planes of PixelState: PixelSums without the median depth.
inline constexpr int kStatePlanes = 11;

/// A tile has eight parts of 8 x 4 pixels, two a quarter; a warp draws one, a pixel a lane.
inline constexpr int kParts = 8;
inline constexpr int kPartPixels = 32;
/// Pixels of a part into which a list entry was blended.
using HitMask = std::uint32_t;

/// A warp of backward() goes through a quarter's list for this many entries.
inline constexpr std::uint32_t kSegment = 128;
struct WalkItem {
  std::uint32_t tile, quarter, segment;
};

/// Counters, in TrainingView::queue.
enum TrainingQueue : int {
  kPairsTaken,     ///< Of `sorted`, by tiles.
  kSegmentsTaken,  ///< Of `segment_state`, by tiles.
  kItems,          ///< Of `item`.
  kNextItem,       ///< Of backward().
  kTrainingQueueWords
};

/// What forward leaves for backward. Tile t has the pairs list_base[t] ... + frame.count[t];
/// hits of its part p start at kParts list_base[t] + p frame.count[t].
struct TrainingView {
  renderer::cuda::FrameView frame;  ///< Lists of one camera, and their buffers.
  renderer::cuda::ViewCamera camera;

  DrawnRecord* drawn;      ///< [surfels] Of those in `visible`.
  SurfelPixels* pixels;    ///< [surfels] The same.
  std::uint32_t* visible;  ///< [FrameStatus::surfels_projected] In any order.
  float* sum;              ///< [surfels, kSums] 0 before backward(), of those in `visible`.
  float* reach_sum;        ///< [surfels] The same.

  std::uint32_t* queue;             ///< [kTrainingQueueWords]
  std::uint32_t* list_base;         ///< [tiles]
  std::uint32_t* read_count;        ///< [tiles, kParts] Entries that the part has looked at.
  renderer::cuda::ListKey* sorted;  ///< [pair_capacity] Those looked at are in order.
  HitMask* hits;                    ///< [kParts pair_capacity]
  std::uint32_t pair_capacity;
  /// [tiles, kStatePlanes, kTilePixels], part by part: sums over all surfels.
  float* state;
  /// [pair_capacity / kSegment + tiles, as `state`] Sums before a segment; of tile t from
  /// segment_base[t] on.
  float* segment_state;
  std::uint32_t* segment_base;  ///< [tiles]
  WalkItem* item;               ///< [4 (pair_capacity / kSegment + tiles)]

  /// Of each entry of a quarter (quarter q of tile t: 4 list_base[t] + q frame.count[t]), for
  /// sums in a fixed order; null: not wanted.
  float* part;        ///< [4 pair_capacity, kSums]
  float* part_reach;  ///< [4 pair_capacity]
};

/// Rows of PixelWeights, and room for them.
struct WeightTable {
  const std::int32_t* pixel;  ///< [pixels]
  std::int64_t pixels;
  int max_per_pixel;        ///< 0: all.
  std::int32_t* all_start;  ///< [pixels + 1] Of rows with all entries.
  std::int32_t* row_start;  ///< [pixels + 1] Of rows with the heaviest.
  std::int32_t *all_surfel, *surfel;
  float *all_weight, *weight;
  std::int32_t* bad_pixels;  ///< Pixels outside the image.
};

/// Surfels -> `drawn` and the tiles' lists.
void launch_project(const TrainingView& view, const SurfelParameters<float>& surfels,
                    cudaStream_t stream);

/// Lists -> images, and what backward needs.
/// @param max_weight  May be null.
void launch_forward(const TrainingView& view, const TrainingImages<float>& images,
                    float* max_weight, cudaStream_t stream);

/// Derivatives by images -> `sum`, `reach_sum`.
void launch_backward(const TrainingView& view, const TrainingImages<const float>& loss,
                     std::uint32_t visible_count, cudaStream_t stream);

/// `sum`, `reach_sum` -> gradients of the visible surfels; empties the sums.
void launch_gradients(const TrainingView& view, const SurfelParameters<float>& surfels,
                      std::uint32_t visible_count, const SurfelGradients<float>& gradients,
                      cudaStream_t stream);

/// Bytes of scratch memory that launch_weight_rows() wants.
[[nodiscard]] std::size_t weight_scan_bytes(std::int64_t pixels);

/// Fills all_start and row_start.
void launch_weight_rows(const TrainingView& view, const WeightTable& table, void* scratch,
                        std::size_t scratch_bytes, cudaStream_t stream);

/// Fills the rows.
void launch_weight_entries(const TrainingView& view, const WeightTable& table,
                           cudaStream_t stream);

}  // namespace segsim::reconstruction::cuda
