#pragma once

/// @file
/// Top-K selection while a pixel is blended: keys in registers where K is small, else in
/// shared memory.
///
/// A key is a weight without the last 8 bits of its fraction and, in 12 bits, 4095 - place, so
/// that of equal weights the nearer is heavier. Places below kPlaces are those of surfels of
/// chunks before, then the present chunk is counted. Weights lie in [2^-24, 1), so that 28
/// bits above those of 2^-24 hold them.

#include <cstddef>
#include <cstdint>

#include "renderer/cuda/device_data.h"
#include "renderer/cuda/tile_shared.cuh"

namespace segsim::renderer::cuda {

constexpr std::uint32_t kPlaceMask = 0xFFF;
constexpr std::uint32_t kLeastWeightBits = 0x33800000;
constexpr float kAnyWeight = 1e-30F;  // That is not 0.
__device__ inline std::uint32_t key_of(float weight, std::uint32_t place) {
  const std::uint32_t bits = (__float_as_uint(weight) - kLeastWeightBits) << 4U;
  return (bits & ~kPlaceMask) | (kPlaceMask - place);
}
__device__ inline float weight_of(std::uint32_t key) {
  return __uint_as_float(((key & ~kPlaceMask) >> 4U) + kLeastWeightBits);
}
__device__ inline std::uint32_t place_of(std::uint32_t key) {
  return kPlaceMask - (key & kPlaceMask);
}
/// The least weight that enters where `key` is the lightest: of what falls on one step the
/// nearer stays.
__device__ inline float weight_above(std::uint32_t key) {
  return weight_of(key + (kPlaceMask + 1));
}

/// A pixel's few surfels, and two numbers of each, in registers.
struct FewSelected {
  static constexpr int kCapacity = kFewKeys;
  float weights[kFewKeys];
  std::uint32_t ids[kFewKeys];  ///< Index in the cloud.
  std::uint32_t kept_numbers[2][kFewKeys];
  int count = 0;
  float total = 0.0F;

  [[nodiscard]] __device__ float weight(int i) const { return weights[i]; }
  [[nodiscard]] __device__ std::uint32_t id(int i) const { return ids[i]; }
  /// Numbers of 16 bits.
  __device__ void keep(int which, int i, std::uint32_t number) {
    kept_numbers[which][i] = number;
  }
  [[nodiscard]] __device__ std::uint32_t kept(int which, int i) const {
    return kept_numbers[which][i];
  }
};

/// A pixel is finished after ln(1e-4) / ln(1 - 1/255) = 2350 surfels: all that it keeps for a
/// while can be numbered.
constexpr int kManyPlaces = kPlaceMask + 1 - kSortKeys;

/// A pixel's many surfels, in shared memory.
struct ManySelected {
  static constexpr int kCapacity = kManyKeys;
  TileShared* shared;
  const std::uint32_t* keys;     ///< Of the pixel.
  const std::uint32_t* earlier;  ///< Of keys of chunks before: indices in the cloud.
  int count = 0;
  float total = 0.0F;

  [[nodiscard]] __device__ float weight(int i) const {
    return weight_of(keys[i * kTilePixels]);
  }
  [[nodiscard]] __device__ std::uint32_t id(int i) const {
    const std::uint32_t place = place_of(keys[i * kTilePixels]);
    return place < kManyPlaces ? earlier[i]
                               : shared->list.id(static_cast<int>(place) - kManyPlaces);
  }
  /// Where there are many, rows are read again.
  __device__ void keep(int, int, std::uint32_t) {}
};

/// Calls take(i, weight, load(id)) for every surfel.
template <class Load, class Take>
__device__ void for_each_surfel(const FewSelected& selected, const Load& load,
                                const Take& take) {
#pragma unroll
  for (int i = 0; i < kFewKeys; ++i) {
    if (i >= selected.count) break;
    take(i, selected.weight(i), load(selected.id(i)));
  }
}

/// The same; four loads are under way at a time.
template <class Load, class Take>
__device__ void for_each_surfel(const ManySelected& selected, const Load& load,
                                const Take& take) {
  constexpr int kTogether = 4;
#pragma unroll 1
  for (int first = 0; first < selected.count; first += kTogether) {
    decltype(load(0U)) value[kTogether];
#pragma unroll
    for (int i = 0; i < kTogether; ++i) {
      value[i] = load(selected.id(min(first + i, selected.count - 1)));
    }
#pragma unroll
    for (int i = 0; i < kTogether; ++i) {
      if (first + i < selected.count) {
        take(first + i, selected.weight(first + i), value[i]);
      }
    }
  }
}

/// Heaviest surfels of a pixel while it is blended. `pixel` is its number in the block.
template <int kKeys>
struct Keys;

template <>
struct Keys<0> {
  static constexpr int kPlaces = 0;
  __device__ void clear() {}
  __device__ bool wants(float) const { return false; }
  __device__ void insert(float, std::uint32_t, TileShared&, int, const FrameView&) {}
  __device__ bool closed(float, const FrameView&) const { return true; }
  __device__ void leave_chunk(TileShared&, int, std::uint32_t*, const FrameView&) {}
};

template <>
struct Keys<kFewKeys> {
  static constexpr int kPlaces = kTilePixels * kFewKeys;
  static_assert(kPlaces + kSortKeys <= kPlaceMask + 1);
  using Selected = FewSelected;

  std::uint32_t key[kFewKeys];
  float least;  ///< Weights below this change nothing.

  __device__ void clear() {
#pragma unroll
    for (std::uint32_t& k : key) k = 0;
    least = kAnyWeight;
  }
  __device__ bool wants(float weight) const { return weight >= least; }
  __device__ void insert(float weight, std::uint32_t place, TileShared&, int,
                         const FrameView&) {
    std::uint32_t x = weight >= least ? key_of(weight, place) : 0U;
#pragma unroll
    for (int k = 0; k < kFewKeys; ++k) {
      const std::uint32_t smaller = min(key[k], x);
      key[k] = max(key[k], x);
      x = smaller;
    }
    if (key[kFewKeys - 1] != 0) least = weight_above(key[kFewKeys - 1]);
  }
  /// Can no later surfel enter? A later weight is at most 0.99 T.
  __device__ bool closed(float transmittance, const FrameView& frame) const {
    const std::uint32_t last = key_at(frame.top_k - 1);
    return last != 0 && kMaxAlpha * transmittance < weight_of(last);
  }
  __device__ std::uint32_t key_at(int k) const {
    return k == 0 ? key[0] : k == 1 ? key[1] : k == 2 ? key[2] : key[3];
  }
  __device__ void leave_chunk(TileShared& shared, int pixel, std::uint32_t*,
                              const FrameView&) {
    std::uint32_t id[kFewKeys];
#pragma unroll
    for (int k = 0; k < kFewKeys; ++k) id[k] = key[k] == 0 ? 0 : id_of(shared, key[k]);
#pragma unroll
    for (int k = 0; k < kFewKeys; ++k) {
      const auto place = static_cast<std::uint32_t>(pixel * kFewKeys + k);
      shared.selection[place] = id[k];
      if (key[k] != 0) key[k] = (key[k] & ~kPlaceMask) | (kPlaceMask - place);
    }
  }
  __device__ static std::uint32_t id_of(const TileShared& shared, std::uint32_t key) {
    const std::uint32_t place = place_of(key);
    return place < kPlaces ? shared.selection[place]
                           : shared.list.id(static_cast<int>(place) - kPlaces);
  }
  __device__ void select(const TileShared& shared, int, const std::uint32_t*,
                         const FrameView& frame, Selected& out) const {
#pragma unroll
    for (int k = 0; k < kFewKeys; ++k) {
      if (k >= frame.top_k || key[k] == 0) break;
      out.weights[k] = weight_of(key[k]);
      out.ids[k] = id_of(shared, key[k]);
      out.total += out.weights[k];
      out.count = k + 1;
    }
  }
};

/// In any order: to find the lightest again costs less than to keep them sorted.
template <>
struct Keys<kManyKeys> {
  static constexpr int kPlaces = kManyPlaces;
  using Selected = ManySelected;

  int count;     ///< Keys of the pixel in shared memory.
  int least_at;  ///< The lightest, once there are K.
  int arrived;   ///< Keys that were there when a chunk ended.
  bool fresh;    ///< Some key is of the present chunk.
  float least;   ///< Weights below this change nothing.

  __device__ void clear() {
    count = least_at = arrived = 0;
    fresh = false;
    least = kAnyWeight;
  }
  __device__ bool wants(float weight) const { return weight >= least; }
  __device__ void insert(float weight, std::uint32_t place, TileShared& shared, int pixel,
                         const FrameView& frame) {
    if (!(weight >= least)) return;
    const int at = count < frame.top_k ? count++ : least_at;
    shared.selection[at * kTilePixels + pixel] = key_of(weight, place);
    fresh = true;
    if (count == frame.top_k) find_lightest(shared.selection + pixel, frame);
  }
  __device__ void find_lightest(const std::uint32_t* keys, const FrameView& frame) {
    if (frame.first_hits) {
      least = INFINITY;
      return;
    }
    std::uint32_t lightest = keys[0];
    least_at = 0;
#pragma unroll 4
    for (int k = 1; k < frame.top_k; ++k) {
      const std::uint32_t key = keys[k * kTilePixels];
      if (key < lightest) {
        lightest = key;
        least_at = k;
      }
    }
    least = weight_above(lightest);
  }
  __device__ bool closed(float transmittance, const FrameView& frame) const {
    return count == frame.top_k && kMaxAlpha * transmittance < least;
  }
  /// Long lists only: what a key names is kept elsewhere, and its place becomes its number
  /// among all that were kept, nearest first. @param earlier  Of the pixel.
  __device__ void leave_chunk(TileShared& shared, int pixel, std::uint32_t* earlier,
                              const FrameView&) {
    std::uint32_t* keys = shared.selection + pixel;
    while (fresh) {
      int nearest = -1;
      std::uint32_t nearest_place = kPlaceMask + 1;
      for (int k = 0; k < count; ++k) {
        const std::uint32_t place = place_of(keys[k * kTilePixels]);
        if (place < kPlaces || place >= nearest_place) continue;
        nearest = k;
        nearest_place = place;
      }
      fresh = nearest >= 0;
      if (!fresh) break;
      earlier[nearest] = shared.list.id(static_cast<int>(nearest_place) - kPlaces);
      keys[nearest * kTilePixels] =
          (keys[nearest * kTilePixels] & ~kPlaceMask) | (kPlaceMask - arrived);
      ++arrived;
    }
  }
  __device__ void select(TileShared& shared, int pixel, const std::uint32_t* earlier,
                         const FrameView&, Selected& out) const {
    out = {&shared, shared.selection + pixel, earlier, count, 0.0F};
    for (int k = 0; k < count; ++k) out.total += out.weight(k);
  }
};

}  // namespace segsim::renderer::cuda
