/// @file
/// Prepares a run of a tile's list for the pixels: every surfel's share of the arithmetic that
/// does not depend on the column is done here once, for the 16 rows of the tile at a time.
///
/// With X the column from the middle of the tile, e and q of surfel_geometry.h, and q' = q /
/// k:
///
///     f = e^2 - |q'|^2 = (a X + b[row]) X + c[row]        hit exactly where f >= 0
///     alpha = 2^(P f) / 255,   P = k^2 / (2 ln 2 e^2)     so that rho = k^2 gives 1/255
///
/// P is a parabola in X where the surfel's depth changes little across the tile (relative
/// error of P below 1e-4), and computed from e elsewhere. The low pass is one more parabola:
/// alpha = 2^L / 255 where L is larger than P f.
///
/// The largest f of a row of pixel centres, at the centre next to the parabola's vertex, tells
/// exactly which cells of 4 x 4 pixels the surfel reaches.
///
/// Included once for every instruction set.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <span>

#include <hwy/cache_control.h>

#include "renderer/raster/tile_cells.h"

#if defined(SEGSIM_RENDERER_TILE_CHUNK_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SEGSIM_RENDERER_TILE_CHUNK_INL_H
#undef SEGSIM_RENDERER_TILE_CHUNK_INL_H
#else
#define SEGSIM_RENDERER_TILE_CHUNK_INL_H
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer::internal {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::CappedTag<float, kCellPixels>;
using Ints = hn::RebindToSigned<Floats>;
using Keys = hn::RebindToUnsigned<Floats>;
using V = hn::Vec<Floats>;
using M = hn::Mask<Floats>;

HWY_INLINE std::uint64_t bits_of(M mask) {
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(Floats(), mask, bytes);
  std::uint64_t bits = 0;
  std::memcpy(&bits, bytes, sizeof bits);
  return bits;
}

/// 1 / x, correctly rounded. The estimates of the hardware would be a little quicker, and
/// differ between instruction sets and between the makers of processors.
HWY_INLINE V inverse_of(V x) { return hn::Div(hn::Set(Floats(), 1.0F), x); }

/// Rounding of f: a cell this far outside is looked at too.
inline constexpr float kHitSlack = -1e-4F;
/// |d e / d X| * 7.5 columns may be this part of e for P to be taken as a parabola.
inline constexpr float kMaxDepthChange = 0.04F;

/// The rows of one surfel.
/// @param first_row, last_row  Of its pixel range, in the tile: only cells in them are
/// prepared.
/// @return  Bit 16 g + y: row y reaches a pixel of column group g.
HWY_INLINE std::uint64_t prepare_rows(const ScreenSurfel& s, float dx, float dy_first,
                                      int first_row, int last_row, bool parabola,
                                      bool low_pass, TilePair& pair) {
  const Floats d;
  const V a = hn::Set(d, pair.a), g0 = hn::Set(d, s.g0);
  const V to_vertex = hn::Set(d, -0.5F / pair.a);
  const float nearest_column = std::floor(-dx) + 0.5F;
  std::uint64_t reached = 0;
  // Most surfels are small: with short vectors, whole cells that one vector holds are one
  // step.
  const auto lanes = static_cast<int>(hn::Lanes(d));
  const int end = (last_row | (kCellPx - 1)) + 1;
  int begin = std::min(first_row & ~(kCellPx - 1), kTileSizePx - lanes);
  if (begin + lanes < end) begin -= begin % lanes;
  for (int row = begin; row < end; row += lanes) {
    // Rounded once, however many rows a vector has.
    const V dy = hn::Add(hn::LoadU(d, kCounting + row), hn::Set(d, dy_first));
    const V q_u = hn::MulAdd(hn::Set(d, s.m01), dy, hn::Set(d, s.m00 * dx));
    const V q_v = hn::MulAdd(hn::Set(d, s.m11), dy, hn::Set(d, s.m10 * dx));
    const V e = hn::NegMulAdd(hn::Set(d, s.g1), dy, hn::Set(d, 1.0F - s.g0 * dx));
    const V c = hn::NegMulAdd(q_v, q_v, hn::NegMulAdd(q_u, q_u, hn::Mul(e, e)));
    const V half_b =
        hn::MulAdd(hn::Set(d, s.m10), q_v, hn::MulAdd(hn::Set(d, s.m00), q_u, hn::Mul(g0, e)));
    const V b = hn::Mul(half_b, hn::Set(d, -2.0F));
    hn::StoreU(b, d, pair.b + row);
    hn::StoreU(c, d, pair.c + row);
    if (parabola) {
      // (1 - t)^-2 = 1 + 2 t + 3 t^2 + 4 t^3 with t^3 spread over t (Chebyshev).
      const V inverse_e = inverse_of(e);
      const V p0 = hn::Mul(hn::Set(d, s.c_k2), hn::Mul(inverse_e, inverse_e));
      const V u = hn::Mul(g0, inverse_e);
      const V uu = hn::Mul(u, u);
      const V stretch = hn::MulAdd(uu, hn::Set(d, 168.75F), hn::Set(d, 2.0F));
      hn::StoreU(p0, d, pair.p0 + row);
      hn::StoreU(hn::Mul(hn::Mul(p0, u), stretch), d, pair.p1 + row);
      hn::StoreU(hn::Mul(hn::Mul(p0, uu), hn::Set(d, 3.0F)), d, pair.p2 + row);
    } else {
      hn::StoreU(e, d, pair.p0 + row);
    }
    const V vertex = hn::Add(hn::Floor(hn::Mul(b, to_vertex)), hn::Set(d, 0.5F));
    V low_pass_c = hn::Zero(d);
    if (low_pass) {
      low_pass_c = hn::NegMulAdd(hn::Mul(dy, dy), hn::Set(d, kLog2E),
                                 hn::Set(d, s.c_k2 - kLog2E * dx * dx));
      hn::StoreU(low_pass_c, d, pair.low_pass_c + row);
    }
    for (int group = 0; group < kCellsPerRow; ++group) {
      const float lo = static_cast<float>(group * kCellPx) - 7.5F, hi = lo + kCellPx - 1;
      const V x = hn::Min(hn::Max(vertex, hn::Set(d, lo)), hn::Set(d, hi));
      M hit = hn::Ge(hn::MulAdd(hn::MulAdd(a, x, b), x, c), hn::Set(d, kHitSlack));
      if (low_pass) {
        const float column = std::clamp(nearest_column, lo, hi);
        const float at_column = (pair.low_pass_b - kLog2E * column) * column;
        hit = hn::Or(
            hit, hn::Ge(hn::Add(low_pass_c, hn::Set(d, at_column)), hn::Set(d, kHitSlack)));
      }
      reached |= bits_of(hit) << (group * kTileSizePx + row);
    }
  }
  const std::uint64_t rows =
      (2U << static_cast<unsigned>(last_row)) - (1U << static_cast<unsigned>(first_row));
  return reached & rows * 0x0001000100010001U;
}

/// Fills chunk.pair[i], chunk.cells[i].
HWY_INLINE void prepare_pair(const ScreenSurfel& s, const SurfelShade& shade, int tile_x,
                             int tile_y, std::uint32_t i, TileChunk& chunk) {
  TilePair& pair = chunk.pair[i];
  chunk.screen[i] = &s;
  const auto x_px = static_cast<float>(tile_x * kTileSizePx);
  const auto y_px = static_cast<float>(tile_y * kTileSizePx);
  const float dx = x_px + 0.5F * kTileSizePx - s.x0_px;
  const float dy_first = y_px + 0.5F - s.y0_px;
  pair.a = s.g0 * s.g0 - s.m00 * s.m00 - s.m10 * s.m10;
  pair.g0 = s.g0;
  pair.c_k2 = s.c_k2;
  pair.dx = dx;
  pair.low_pass_b = -2.0F * kLog2E * dx;
  pair.shade = shade;
  if (s.shape >= SurfelShape::kCare || !(pair.a < 0.0F)) {
    pair.kind = PairKind::kCare;
    chunk.cells[i] = cells_of_rectangle(s, tile_x, tile_y);
    return;
  }
  const int first_row = std::max(s.y_lo - tile_y * kTileSizePx, 0);
  const int last_row = std::min(s.y_hi - tile_y * kTileSizePx, kTileSizePx - 1);
  if (first_row > last_row) {  // Of a coarser list (TileBounds).
    pair.kind = PairKind::kPlain;
    chunk.cells[i] = 0;
    return;
  }
  const float e_first = 1.0F - s.g0 * dx - s.g1 * dy_first;
  const float e_last = e_first - s.g1 * static_cast<float>(kTileSizePx - 1);
  const bool parabola = std::min(e_first, e_last) * kMaxDepthChange > 7.5F * std::abs(s.g0);
  const bool low_pass = s.shape == SurfelShape::kThin;
  pair.kind = low_pass ? (parabola ? PairKind::kThinParabola : PairKind::kThinExact)
                       : (parabola ? PairKind::kPlain : PairKind::kExact);
  const std::uint64_t rows =
      low_pass ? prepare_rows(s, dx, dy_first, first_row, last_row, parabola, true, pair)
               : prepare_rows(s, dx, dy_first, first_row, last_row, parabola, false, pair);
  chunk.cells[i] = cells_of_rows(rows);
}

/// Entries [begin, begin + kChunk) of the list.
HWY_INLINE void load_chunk(const ProjectedSurfels& projected,
                           std::span<const std::uint32_t> list, std::uint32_t begin,
                           int tile_x, int tile_y, TileChunk& chunk) {
  constexpr std::uint32_t kAhead = 8;
  chunk.count = std::min(kChunk, static_cast<std::uint32_t>(list.size()) - begin);
  for (std::uint32_t i = 0; i < chunk.count; ++i) {
    if (begin + i + kAhead < list.size()) {
      hwy::Prefetch(&projected.screen[list[begin + i + kAhead]]);
      hwy::Prefetch(&projected.shade[list[begin + i + kAhead]]);
    }
    const std::uint32_t slot = list[begin + i];
    chunk.slot[i] = slot;
    chunk.pair[i].list_position = begin + i;
    // Windows start at multiples of their size.
    chunk.pair[i].key_position = (begin + i) % kWindow ^ kKeyPositionMask;
    prepare_pair(projected.screen[slot], projected.shade[slot], tile_x, tile_y, i, chunk);
  }
  std::fill(chunk.cells + chunk.count, chunk.cells + kChunk, std::uint16_t{0});
}

/// Bit i: entry i of the chunk reaches the cell.
HWY_INLINE std::uint64_t surfels_of_cell(const TileChunk& chunk, int cell) {
  const hn::CappedTag<std::uint16_t, kChunk> d;
  const auto bit = hn::Set(d, static_cast<std::uint16_t>(1U << cell));
  std::uint64_t found = 0;
  for (std::size_t i = 0; i < kChunk; i += hn::Lanes(d)) {
    std::uint8_t bytes[8] = {};
    hn::StoreMaskBits(d, hn::TestBit(hn::Load(d, chunk.cells + i), bit), bytes);
    std::uint64_t bits = 0;
    std::memcpy(&bits, bytes, sizeof bits);
    found |= bits << i;
  }
  return found;
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer::internal
HWY_AFTER_NAMESPACE();

#endif  // per target
