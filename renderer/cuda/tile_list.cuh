#pragma once

/// @file
/// A tile's list in order of depth, a chunk at a time: lists that fit are sorted at once, and
/// of longer ones the nearest part is looked for first, because most tiles end there.

#include <cstdint>

#include "renderer/cuda/device_data.h"
#include "renderer/cuda/warp.cuh"

namespace segsim::renderer::cuda {

inline constexpr int kTileThreads = 128;  ///< A block of the renderer; others may differ.
/// Keys that are sorted together; of longer lists at most kSelectedKeys.
inline constexpr int kSortKeys = 1024;
inline constexpr int kSelectedKeys = 1024;
inline constexpr ListKey kNoKey = ~0ULL;

struct ListShared {
  ListKey key[kSortKeys];         ///< Of the chunk, in any order.
  std::uint32_t rank[kSortKeys];  ///< The chunk in order: depth step << 10 | place in `key`.
  std::uint32_t histogram[256];
  ListKey range_begin, range_end;
  ListKey last_key;  ///< Of a long list.
  std::uint32_t gathered, least, most;
  int found;

  [[nodiscard]] __device__ ListKey sorted(int i) const {
    return key[rank[i] & (kSortKeys - 1)];
  }
  [[nodiscard]] __device__ std::uint32_t id(int i) const {
    return static_cast<std::uint32_t>(sorted(i)) >> kQuarterBits;
  }
  [[nodiscard]] __device__ std::uint32_t quarters(int i) const {
    return static_cast<std::uint32_t>(sorted(i)) & ((1U << kQuarterBits) - 1U);
  }
  [[nodiscard]] __device__ std::uint32_t depth_bits(int i) const {
    return static_cast<std::uint32_t>(sorted(i) >> 32);
  }
};

constexpr int kPlaceBits = 10;
static_assert(kSortKeys == 1 << kPlaceBits);

/// Bitonic sort of rank[0 ... kThreads * kEach - 1]: a thread holds kEach neighbours.
template <int kThreads, int kEach>
__device__ void sort_ranks(std::uint32_t* rank) {
  constexpr int kCount = kThreads * kEach;
  const int thread = static_cast<int>(threadIdx.x);
  const int first = thread * kEach;
  std::uint32_t v[kEach];
#pragma unroll
  for (int e = 0; e < kEach; ++e) v[e] = rank[first + e];
  for (int size = 2; size <= kCount; size *= 2) {
    int stride = size / 2;
    for (; stride >= kWarp * kEach; stride /= 2) {  // Another warp's.
      const bool keeps_less = ((first & size) == 0) == ((first & stride) == 0);
      const int other = thread ^ (stride / kEach);
      __syncthreads();
#pragma unroll
      for (int e = 0; e < kEach; ++e) rank[e * kThreads + thread] = v[e];
      __syncthreads();
#pragma unroll
      for (int e = 0; e < kEach; ++e) {
        const std::uint32_t theirs = rank[e * kThreads + other];
        v[e] = keeps_less ? min(v[e], theirs) : max(v[e], theirs);
      }
    }
    for (; stride >= kEach; stride /= 2) {  // Another lane's.
      const bool keeps_less = ((first & size) == 0) == ((first & stride) == 0);
#pragma unroll
      for (int e = 0; e < kEach; ++e) {
        const std::uint32_t theirs = __shfl_xor_sync(kAllLanes, v[e], stride / kEach);
        v[e] = keeps_less ? min(v[e], theirs) : max(v[e], theirs);
      }
    }
#pragma unroll
    for (int near = kEach / 2; near > 0; near /= 2) {  // The thread's own.
      if (near > size / 2) continue;
#pragma unroll
      for (int e = 0; e < kEach; ++e) {
        if ((e & near) != 0) continue;
        const bool ascends = ((first + e) & size) == 0;
        const std::uint32_t less = min(v[e], v[e + near]), more = max(v[e], v[e + near]);
        v[e] = ascends ? less : more;
        v[e + near] = ascends ? more : less;
      }
    }
  }
  __syncthreads();
#pragma unroll
  for (int e = 0; e < kEach; ++e) rank[first + e] = v[e];
  __syncthreads();
}

/// Puts right what fell into one depth step: neighbours change places until all are in order.
template <int kThreads>
__device__ void sort_within_steps(ListShared& shared, int count) {
  const int thread = static_cast<int>(threadIdx.x);
  bool changed = true;
  while (changed) {
    bool mine = false;
    for (int parity = 0; parity < 2; ++parity) {
      for (int i = 2 * thread + parity; i + 1 < count; i += 2 * kThreads) {
        const std::uint32_t a = shared.rank[i], b = shared.rank[i + 1];
        if (a >> kPlaceBits != b >> kPlaceBits) continue;
        if (shared.key[a & (kSortKeys - 1)] <= shared.key[b & (kSortKeys - 1)]) continue;
        shared.rank[i] = b;
        shared.rank[i + 1] = a;
        mine = true;
      }
      __syncthreads();
    }
    changed = __syncthreads_or(mine ? 1 : 0) != 0;
  }
}

/// Orders key[0 ... count - 1]. Depths are sorted in 2^22 steps between the least and the
/// most, then exactly within a step, which is rarely needed.
template <int kThreads>
__device__ void sort_keys(ListShared& shared, int count) {
  const int thread = static_cast<int>(threadIdx.x);
  if (thread == 0) shared.least = 0xFFFFFFFFU, shared.most = 0;
  __syncthreads();
  std::uint32_t least = 0xFFFFFFFFU, most = 0;
  for (int i = thread; i < count; i += kThreads) {
    const auto bits = static_cast<std::uint32_t>(shared.key[i] >> 32);
    least = min(least, bits);
    most = max(most, bits);
  }
  least = __reduce_min_sync(kAllLanes, least);
  most = __reduce_max_sync(kAllLanes, most);
  if (lane_index() == 0) {
    atomicMin(&shared.least, least);
    atomicMax(&shared.most, most);
  }
  __syncthreads();
  least = shared.least;
  const int range_bits = 32 - __clz(static_cast<int>(shared.most - least));
  const int shift = max(0, range_bits - (32 - kPlaceBits));
  int padded = kThreads;
  while (padded < count) padded *= 2;
  for (int i = thread; i < padded; i += kThreads) {
    const auto bits = static_cast<std::uint32_t>(shared.key[i] >> 32);
    shared.rank[i] = i < count ? (bits - least) >> shift << kPlaceBits | i : 0xFFFFFFFFU;
  }
  __syncthreads();
  switch (padded / kThreads) {
    case 1:
      sort_ranks<kThreads, 1>(shared.rank);
      break;
    case 2:
      sort_ranks<kThreads, 2>(shared.rank);
      break;
    case 4:
      sort_ranks<kThreads, 4>(shared.rank);
      break;
    default:
      sort_ranks<kThreads, kSortKeys / kThreads>(shared.rank);
  }
  sort_within_steps<kThreads>(shared, count);
}

/// The least key of a list; the largest goes to shared.last_key.
template <int kThreads>
__device__ ListKey find_ends(ListShared& shared, const ListKey* list, int count) {
  const int thread = static_cast<int>(threadIdx.x);
  if (thread == 0) {
    shared.range_begin = kNoKey;
    shared.last_key = 0;
  }
  __syncthreads();
  ListKey least = kNoKey, most = 0;
#pragma unroll 4
  for (int i = thread; i < count; i += kThreads) {
    least = min(least, list[i]);
    most = max(most, list[i]);
  }
#pragma unroll
  for (int step = kWarp / 2; step > 0; step /= 2) {
    least = min(least, __shfl_xor_sync(kAllLanes, least, step));
    most = max(most, __shfl_xor_sync(kAllLanes, most, step));
  }
  if (lane_index() == 0) {
    atomicMin(&shared.range_begin, least);
    atomicMax(&shared.last_key, most);
  }
  __syncthreads();
  least = shared.range_begin;
  __syncthreads();
  return least;
}

/// Finds the last key of a range that starts at `begin` and holds 1 ... kSelectedKeys of the
/// list's keys; some key must be >= begin.
template <int kThreads>
__device__ ListKey find_range(ListShared& shared, const ListKey* list, int count,
                              ListKey begin) {
  const int thread = static_cast<int>(threadIdx.x);
  if (thread == 0) {
    shared.range_begin = begin;
    shared.range_end = shared.last_key;
    shared.found = 0;
  }
  __syncthreads();
  while (shared.found == 0) {
    const ListKey first = shared.range_begin, last = shared.range_end;
    const int bits = 64 - __clzll(static_cast<long long>(last - first));
    const int shift = bits > 8 ? bits - 8 : 0;
    for (int i = thread; i < 256; i += kThreads) shared.histogram[i] = 0;
    __syncthreads();
#pragma unroll 4
    for (int i = thread; i < count; i += kThreads) {
      const ListKey key = list[i];
      if (key >= first && key <= last)
        atomicAdd(&shared.histogram[(key - first) >> shift], 1U);
    }
    __syncthreads();
    if (thread < kWarp) {
      constexpr int kEach = 256 / kWarp;
      int sum = 0;
      for (int i = 0; i < kEach; ++i) {
        sum += static_cast<int>(shared.histogram[thread * kEach + i]);
      }
      const int inclusive = inclusive_sum(sum);
      const unsigned over = __ballot_sync(kAllLanes, inclusive > kSelectedKeys);
      if (over == 0) {
        if (thread == 0) shared.found = 1;
      } else if (thread == __ffs(static_cast<int>(over)) - 1) {
        int before = inclusive - sum, bin = thread * kEach;
        while (before + static_cast<int>(shared.histogram[bin]) <= kSelectedKeys) {
          before += static_cast<int>(shared.histogram[bin++]);
        }
        const ListKey bin_begin = first + (static_cast<ListKey>(bin) << shift);
        if (before > 0) {
          shared.range_end = bin_begin - 1;
          shared.found = 1;
        } else {  // This bin alone is too much: look into it.
          shared.range_begin = bin_begin;
          shared.range_end = bin_begin + ((1ULL << shift) - 1);
        }
      }
    }
    __syncthreads();
  }
  const ListKey end = shared.range_end;
  __syncthreads();
  return end;
}

/// Makes the next chunk the shared one, in order.
/// @param next  First key that was not in a chunk yet; moved past this one.
/// @return  Keys of the chunk; 0 at the end of the list.
/// @tparam kThreads  Of the block, which calls it together: 128 or 256.
template <int kThreads>
__device__ int next_chunk(ListShared& shared, const ListKey* list, int count, int done,
                          ListKey& next) {
  const int thread = static_cast<int>(threadIdx.x);
  if (done >= count) return 0;
  if (count <= kSortKeys) {
    for (int i = thread; i < count; i += kThreads) shared.key[i] = list[i];
    sort_keys<kThreads>(shared, count);
    return count;
  }
  if (thread == 0) shared.gathered = 0;
  if (done == 0) next = find_ends<kThreads>(shared, list, count);
  const ListKey last = find_range<kThreads>(shared, list, count, next);
#pragma unroll 4
  for (int i = thread; i < count; i += kThreads) {
    const ListKey key = list[i];
    if (key >= next && key <= last) shared.key[atomicAdd(&shared.gathered, 1U)] = key;
  }
  __syncthreads();
  const int found = static_cast<int>(shared.gathered);
  sort_keys<kThreads>(shared, found);
  next = last + 1;
  return found;
}

}  // namespace segsim::renderer::cuda
