#include "renderer/internal/tile_raster.h"

#include <algorithm>

#include "renderer/internal/tile_state.h"

#include <hwy/cache_control.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/internal/tile_raster.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SEGSIM_RENDERER_TILE_RASTER_ONCE
#define SEGSIM_RENDERER_TILE_RASTER_ONCE
namespace segsim::renderer::internal {
namespace {

/// List entries that are copied next to one another before the pixels read them: 12 KB, so
/// that they stay in the first-level cache.
constexpr std::uint32_t kChunk = 128;
constexpr int kRowsPerStep = 2;
/// Keys that fit in registers; with more of them they stay in memory.
constexpr int kRegisterKeys = 4;

/// Surfels [begin, begin + count) of a tile's list.
struct ChunkData {
  alignas(64) ScreenSurfel screen[kChunk];
  alignas(64) SurfelShade shade[kChunk];
  /// Rectangle of pixels in the tile, inclusive.
  std::uint8_t x_lo[kChunk], x_hi[kChunk], y_lo[kChunk], y_hi[kChunk];
  std::uint32_t count = 0, window_position = 0;
};

void load_chunk(const RasterJob& job, std::span<const std::uint32_t> list, std::uint32_t begin,
                int tile_x, int tile_y, ChunkData& chunk) {
  constexpr std::uint32_t kAhead = 8;
  chunk.count = std::min(kChunk, static_cast<std::uint32_t>(list.size()) - begin);
  chunk.window_position = begin % kWindow;
  const int x0 = tile_x * kTileSizePx, y0 = tile_y * kTileSizePx;
  const auto in_tile = [](int pixel) {
    return static_cast<std::uint8_t>(std::clamp(pixel, 0, kTileSizePx - 1));
  };
  for (std::uint32_t i = 0; i < chunk.count; ++i) {
    if (begin + i + kAhead < list.size()) {
      hwy::Prefetch(&job.projected.screen[list[begin + i + kAhead]]);
      hwy::Prefetch(&job.projected.shade[list[begin + i + kAhead]]);
    }
    const std::uint32_t slot = list[begin + i];
    const ScreenSurfel& s = job.projected.screen[slot];
    chunk.screen[i] = s;
    chunk.shade[i] = job.projected.shade[slot];
    chunk.x_lo[i] = in_tile(s.x_lo - x0);
    chunk.x_hi[i] = in_tile(s.x_hi - x0);
    chunk.y_lo[i] = in_tile(s.y_lo - y0);
    chunk.y_hi[i] = in_tile(s.y_hi - y0);
  }
}

/// Entries of the chunk whose rectangle meets a block of pixels.
std::uint32_t find_candidates(const ChunkData& chunk, int x, int width, int y, int height,
                              std::uint8_t* found) {
  std::uint32_t count = 0;
  for (std::uint32_t i = 0; i < chunk.count; ++i) {
    found[count] = static_cast<std::uint8_t>(i);
    count += static_cast<std::uint32_t>((chunk.y_lo[i] < y + height) & (chunk.y_hi[i] >= y) &
                                        (chunk.x_lo[i] < x + width) & (chunk.x_hi[i] >= x));
  }
  return count;
}

}  // namespace
}  // namespace segsim::renderer::internal
#endif  // SEGSIM_RENDERER_TILE_RASTER_ONCE

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer::internal {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::CappedTag<float, kTileSizePx>;
using Ints = hn::RebindToSigned<Floats>;
using Keys = hn::RebindToUnsigned<Floats>;
using V = hn::Vec<Floats>;
using K = hn::Vec<Keys>;
using M = hn::Mask<Floats>;

/// 2^x for -30 <= x <= 0, relative error 4e-6: degree 4 through the Chebyshev nodes.
HWY_INLINE V exp2_of(V x) {
  const Floats d;
  const Ints di;
  const V whole = hn::Round(x);
  const V f = hn::Sub(x, whole);
  V p = hn::MulAdd(hn::Set(d, 0.00966637F), f, hn::Set(d, 0.05592198F));
  p = hn::MulAdd(p, f, hn::Set(d, 0.24022349F));
  p = hn::MulAdd(p, f, hn::Set(d, 0.69312105F));
  p = hn::MulAdd(p, f, hn::Set(d, 1.0F));
  const auto exponent = hn::ShiftLeft<23>(hn::Add(hn::ConvertTo(di, whole), hn::Set(di, 127)));
  return hn::Mul(p, hn::BitCast(d, exponent));
}

/// 1 / x; the estimate of the hardware and one Newton step.
HWY_INLINE V inverse_of(V x) {
  const V estimate = hn::ApproximateReciprocal(x);
  return hn::Mul(estimate, hn::NegMulAdd(x, estimate, hn::Set(Floats(), 2.0F)));
}

/// Where a row of pixels meets a surfel; `inverse_e` = depth / z0.
struct Hit {
  V rho, inverse_e;
  M hit;
};

/// The plain formula of surfel_geometry.h, for a disc wider than the low pass and beyond the
/// near plane. Division comes after the test.
HWY_INLINE void finish_plain(V q_u, V q_v, V e, V k2, M live, Hit& out) {
  const V q2 = hn::MulAdd(q_u, q_u, hn::Mul(q_v, q_v));
  out.hit = hn::And(live, hn::Le(q2, hn::Mul(k2, hn::Mul(e, e))));
  out.inverse_e = inverse_of(e);
  out.rho = hn::Mul(q2, hn::Mul(out.inverse_e, out.inverse_e));
}

/// With low pass and near plane. Outside [e_min, e_max] the plane is behind the near plane or
/// beyond the disc, so that only the low pass can hit, at a depth within the disc's range.
HWY_INLINE void finish_with_care(const ScreenSurfel& s, V q_u, V q_v, V e, V offset2, V k2,
                                 M live, Hit& out) {
  const Floats d;
  const V e_min = hn::Set(d, s.e_min), e_max = hn::Set(d, s.e_max);
  const M on_disc = hn::And(hn::Ge(e, e_min), hn::Le(e, e_max));
  out.inverse_e = inverse_of(hn::Min(hn::Max(e, e_min), e_max));
  const V q2 = hn::MulAdd(q_u, q_u, hn::Mul(q_v, q_v));
  const V rho_disc = hn::Mul(q2, hn::Mul(out.inverse_e, out.inverse_e));
  const V rho_low_pass = hn::Add(offset2, offset2);
  out.rho = hn::IfThenElse(on_disc, hn::Min(rho_disc, rho_low_pass), rho_low_pass);
  out.hit = hn::And(live, hn::Le(out.rho, k2));
}

/// Puts a key into the sorted set, dropping the lightest.
template <int kKeys>
HWY_INLINE void insert_key(K key, K* keys) {
  for (int k = 0; k < kKeys; ++k) {
    const K smaller = hn::Min(keys[k], key);
    keys[k] = hn::Max(keys[k], key);
    key = smaller;
  }
}

/// The same for a set in memory, one plane a rank; gated, since few surfels get in.
HWY_INLINE void insert_key_in_memory(K key, int key_count, TileState& state,
                                     std::size_t pixel) {
  const Keys dk;
  const K lightest = hn::Load(dk, &state.keys[key_count - 1][pixel]);
  if (hn::AllFalse(dk, hn::Gt(key, lightest))) return;
  for (int k = 0; k < key_count; ++k) {
    const K present = hn::Load(dk, &state.keys[k][pixel]);
    hn::Store(hn::Max(present, key), dk, &state.keys[k][pixel]);
    key = hn::Min(present, key);
  }
}

/// One row of a block in registers.
template <bool kRgb, bool kNormal, int kKeys>
struct Row {
  V transmittance, depth, r, g, b, nx, ny, nz;
  M live;
  K keys[kKeys == kRegisterKeys ? kRegisterKeys : 1];

  HWY_INLINE void load(const TileState& state, std::size_t p) {
    const Floats d;
    transmittance = hn::Load(d, &state.transmittance[p]);
    depth = hn::Load(d, &state.depth[p]);
    live = hn::Gt(hn::Load(d, &state.live[p]), hn::Zero(d));
    if constexpr (kRgb) {
      r = hn::Load(d, &state.r[p]);
      g = hn::Load(d, &state.g[p]);
      b = hn::Load(d, &state.b[p]);
    }
    if constexpr (kNormal) {
      nx = hn::Load(d, &state.nx[p]);
      ny = hn::Load(d, &state.ny[p]);
      nz = hn::Load(d, &state.nz[p]);
    }
    if constexpr (kKeys == kRegisterKeys) {
      for (int k = 0; k < kKeys; ++k) keys[k] = hn::Load(Keys(), &state.keys[k][p]);
    }
  }

  HWY_INLINE void store(TileState& state, std::size_t p) const {
    const Floats d;
    hn::Store(transmittance, d, &state.transmittance[p]);
    hn::Store(depth, d, &state.depth[p]);
    hn::Store(hn::IfThenElseZero(live, hn::Set(d, 1.0F)), d, &state.live[p]);
    if constexpr (kRgb) {
      hn::Store(r, d, &state.r[p]);
      hn::Store(g, d, &state.g[p]);
      hn::Store(b, d, &state.b[p]);
    }
    if constexpr (kNormal) {
      hn::Store(nx, d, &state.nx[p]);
      hn::Store(ny, d, &state.ny[p]);
      hn::Store(nz, d, &state.nz[p]);
    }
    if constexpr (kKeys == kRegisterKeys) {
      for (int k = 0; k < kKeys; ++k) hn::Store(keys[k], Keys(), &state.keys[k][p]);
    }
  }

  /// Blends a surfel into the pixels that it hits; finishes those that it would saturate.
  HWY_INLINE void blend(const Hit& at, const ScreenSurfel& s, const SurfelShade& shade,
                        std::uint32_t position, int key_count, bool median_depth,
                        TileState& state, std::size_t p) {
    const Floats d;
    constexpr float kHalfLog2E = 0.72134752F;
    const V exponent =
        hn::NegMulAdd(at.rho, hn::Set(d, kHalfLog2E), hn::Set(d, s.log2_opacity));
    // Lanes that are not hit may hold anything; the bound keeps them out of exp2's overflow.
    const V alpha =
        hn::Min(exp2_of(hn::Max(exponent, hn::Set(d, -30.0F))), hn::Set(d, kMaxAlpha));
    V weight = hn::IfThenElseZero(at.hit, hn::Mul(alpha, transmittance));
    V left = hn::Sub(transmittance, weight);
    const M finished = hn::And(at.hit, hn::Lt(left, hn::Set(d, kStopTransmittance)));
    if (HWY_UNLIKELY(!hn::AllFalse(d, finished))) {
      live = hn::AndNot(finished, live);
      weight = hn::IfThenZeroElse(finished, weight);
      left = hn::IfThenElse(finished, transmittance, left);
    }
    if (median_depth) {
      const V half = hn::Set(d, 1.0F - kMinSurfaceAlpha);
      const M in_front = hn::And(hn::Gt(weight, hn::Zero(d)), hn::Gt(transmittance, half));
      depth = hn::IfThenElse(in_front, hn::Mul(at.inverse_e, hn::Set(d, s.z0_m)), depth);
    } else {
      const V stretch = hn::IfThenElseZero(at.hit, at.inverse_e);
      depth = hn::MulAdd(hn::Mul(weight, stretch), hn::Set(d, s.z0_m), depth);
    }
    transmittance = left;
    if constexpr (kRgb) {
      r = hn::MulAdd(weight, hn::Set(d, shade.r), r);
      g = hn::MulAdd(weight, hn::Set(d, shade.g), g);
      b = hn::MulAdd(weight, hn::Set(d, shade.b), b);
    }
    if constexpr (kNormal) {
      nx = hn::MulAdd(weight, hn::Set(d, shade.nx), nx);
      ny = hn::MulAdd(weight, hn::Set(d, shade.ny), ny);
      nz = hn::MulAdd(weight, hn::Set(d, shade.nz), nz);
    }
    if constexpr (kKeys > 0) {
      const Keys dk;
      const K bits = hn::And(hn::BitCast(dk, weight), hn::Set(dk, ~kKeyPositionMask));
      const K key = hn::Or(bits, hn::Set(dk, position));
      if constexpr (kKeys == kRegisterKeys) {
        insert_key<kKeys>(key, keys);
      } else {
        insert_key_in_memory(key, key_count, state, p);
      }
    }
  }
};

/// Blends the candidates into a block of kRowsPerStep rows of one vector.
/// @param x, y  First pixel of the block in the tile.
/// @return  False if all its pixels are finished.
template <bool kRgb, bool kNormal, int kKeys>
bool raster_block(const ChunkData& chunk, const std::uint8_t* candidates, std::uint32_t count,
                  int tile_x, int tile_y, int x, int y, int key_count, bool median_depth,
                  TileState& state, TileStats& stats) {
  const Floats d;
  const auto p0 = static_cast<std::size_t>(y * kTileSizePx + x);
  const std::size_t p1 = p0 + kTileSizePx;
  Row<kRgb, kNormal, kKeys> row0, row1;
  row0.load(state, p0);
  row1.load(state, p1);
  const V x_px = hn::Iota(d, static_cast<float>(tile_x * kTileSizePx + x) + 0.5F);
  const float y_px = static_cast<float>(tile_y * kTileSizePx + y) + 0.5F;
  bool any_live = true;
  std::uint32_t c = 0;
  for (; c < count && any_live; ++c) {
    const std::uint32_t i = candidates[c];
    const ScreenSurfel& s = chunk.screen[i];
    const V dx = hn::Sub(x_px, hn::Set(d, s.x0_px));
    const float dy = y_px - s.y0_px;
    const V q_u0 = hn::MulAdd(hn::Set(d, s.m00), dx, hn::Set(d, s.m01 * dy));
    const V q_v0 = hn::MulAdd(hn::Set(d, s.m10), dx, hn::Set(d, s.m11 * dy));
    const V e0 = hn::NegMulAdd(hn::Set(d, s.g0), dx, hn::Set(d, 1.0F - s.g1 * dy));
    const V q_u1 = hn::Add(q_u0, hn::Set(d, s.m01));
    const V q_v1 = hn::Add(q_v0, hn::Set(d, s.m11));
    const V e1 = hn::Sub(e0, hn::Set(d, s.g1));
    const V k2 = hn::Set(d, s.k2);
    Hit hit0, hit1;
    if (s.needs_care != 0) {
      const V dx2 = hn::Mul(dx, dx);
      finish_with_care(s, q_u0, q_v0, e0, hn::Add(dx2, hn::Set(d, dy * dy)), k2, row0.live,
                       hit0);
      const float dy1 = dy + 1.0F;
      finish_with_care(s, q_u1, q_v1, e1, hn::Add(dx2, hn::Set(d, dy1 * dy1)), k2, row1.live,
                       hit1);
    } else {
      finish_plain(q_u0, q_v0, e0, k2, row0.live, hit0);
      finish_plain(q_u1, q_v1, e1, k2, row1.live, hit1);
    }
    if (hn::AllFalse(d, hn::Or(hit0.hit, hit1.hit))) continue;
    stats.contributions += hn::CountTrue(d, hit0.hit) + hn::CountTrue(d, hit1.hit);
    const std::uint32_t position = chunk.window_position + i;
    row0.blend(hit0, s, chunk.shade[i], position, key_count, median_depth, state, p0);
    row1.blend(hit1, s, chunk.shade[i], position, key_count, median_depth, state, p1);
    any_live = !hn::AllFalse(d, hn::Or(row0.live, row1.live));
  }
  stats.evaluations += static_cast<std::uint64_t>(c) * kRowsPerStep * hn::Lanes(d);
  row0.store(state, p0);
  row1.store(state, p1);
  return any_live;
}

template <bool kRgb, bool kNormal, int kKeys>
TileStats raster_tile_with(const RasterJob& job, std::size_t tile) {
  constexpr int kMaxBlocks = kTileSizePx * kTileSizePx / kRowsPerStep;
  const std::span<const std::uint32_t> list = job.bins.list(tile);
  const auto index = static_cast<int>(tile);
  const int tile_x = index % job.bins.tiles_x(), tile_y = index / job.bins.tiles_x();
  const auto lanes = static_cast<int>(hn::Lanes(Floats()));
  const int key_count = kKeys == kRegisterKeys ? kRegisterKeys : kKeys == 0 ? 0 : job.top_k;
  TileState state;  // Not initialised: clear_tile() fills what this job uses.
  clear_tile(job, tile, key_count, state);
  TileStats stats;
  ChunkData chunk;
  std::uint8_t candidates[kChunk + 1];
  std::uint8_t block_live[kMaxBlocks];
  std::fill_n(block_live, kMaxBlocks, std::uint8_t{1});
  std::uint32_t window = 0;
  bool tile_live = true;
  for (std::uint32_t begin = 0; begin < list.size() && tile_live; begin += kChunk) {
    if (begin != window && begin % kWindow == 0) {
      if constexpr (kKeys > 0) close_window(job, list, window, state);
      window = begin;
    }
    load_chunk(job, list, begin, tile_x, tile_y, chunk);
    stats.pairs_touched += chunk.count;
    tile_live = false;
    int block = 0;
    for (int y = 0; y < kTileSizePx; y += kRowsPerStep) {
      for (int x = 0; x < kTileSizePx; x += lanes, ++block) {
        if (block_live[block] == 0) continue;
        const std::uint32_t count =
            find_candidates(chunk, x, lanes, y, kRowsPerStep, candidates);
        const bool live =
            raster_block<kRgb, kNormal, kKeys>(chunk, candidates, count, tile_x, tile_y, x, y,
                                               key_count, job.median_depth, state, stats);
        block_live[block] = live ? 1 : 0;
        tile_live |= live;
      }
    }
  }
  write_tile(job, tile, list, window, state);
  return stats;
}

template <bool kRgb, bool kNormal>
TileStats raster_tile_keys(const RasterJob& job, std::size_t tile) {
  if (!job.labelled || !core::has(job.channels, core::Channels::kLabels)) {
    return raster_tile_with<kRgb, kNormal, 0>(job, tile);
  }
  if (job.top_k <= kRegisterKeys) {
    return raster_tile_with<kRgb, kNormal, kRegisterKeys>(job, tile);
  }
  return raster_tile_with<kRgb, kNormal, kMaxTopK>(job, tile);
}

TileStats raster_tile_simd(const RasterJob& job, std::size_t tile) {
  const bool rgb = core::has(job.channels, core::Channels::kRgb);
  const bool normal = core::has(job.channels, core::Channels::kNormal);
  if (rgb) {
    return normal ? raster_tile_keys<true, true>(job, tile)
                  : raster_tile_keys<true, false>(job, tile);
  }
  return normal ? raster_tile_keys<false, true>(job, tile)
                : raster_tile_keys<false, false>(job, tile);
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer::internal
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace segsim::renderer::internal {
namespace {

HWY_EXPORT(raster_tile_simd);

}  // namespace

TileStats raster_tile(const RasterJob& job, std::size_t tile) {
  return HWY_DYNAMIC_DISPATCH(raster_tile_simd)(job, tile);
}

}  // namespace segsim::renderer::internal
#endif  // HWY_ONCE
