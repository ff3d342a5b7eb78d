/// @file
/// Blends the surfels of a chunk into one vector of pixels of a cell. The state lives in
/// registers; three versions of the loop shed what can no longer change:
///
///     some pixel has T > 1/2                  its median depth is still open
///     some pixel has 0.99 T > its K-th weight its Top-K may still change: no later weight
///                                             can exceed 0.99 T
///     else                                    colour, normal and T only
///
/// Included once for every instruction set.

#include <bit>

#include "renderer/raster/compat_rules.h"
#include "renderer/raster/tile_cells.h"
#include "renderer/raster/tile_raster.h"

#if defined(SEGSIM_RENDERER_TILE_CELL_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SEGSIM_RENDERER_TILE_CELL_INL_H
#undef SEGSIM_RENDERER_TILE_CELL_INL_H
#else
#define SEGSIM_RENDERER_TILE_CELL_INL_H
#endif

#include <hwy/highway.h>

#include "renderer/raster/tile_chunk-inl.h"

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer::internal {
namespace HWY_NAMESPACE {

/// Keys that fit in registers; with more of them they stay in memory.
inline constexpr int kRegisterKeys = 4;
/// Surfels between two looks at whether a shorter loop will do. 0.01^16 of the stop is still a
/// normal number.
inline constexpr int kBatch = 8;

/// The values of four rows, repeated for every column of the vector.
HWY_INLINE V rows_of(const float* four_rows, [[maybe_unused]] int lane) {
  const Floats d;
#if HWY_TARGET == HWY_SCALAR
  return hn::Set(d, four_rows[lane % kCellPx]);
#else
  return hn::LoadDup128(d, four_rows);
#endif
}

/// 2^(f p) / 255; where f p > 8.01 or < -100 anything.
HWY_INLINE V alpha_of(V f, V p) {
  const Floats d;
  const Ints di;
  constexpr float kRounder = 12582912.0F;  // 1.5 * 2^23: the sum's low bits are round(f p).
  constexpr float kScale = 1.0F / 255.0F;
  const V sum = hn::MulAdd(f, p, hn::Set(d, kRounder));
  const V whole = hn::Sub(sum, hn::Set(d, kRounder));
  const V x = hn::MulSub(f, p, whole);
  // 2^x / 255 for |x| <= 1/2, relative error 4e-6: degree 4 through the Chebyshev nodes.
  V y = hn::MulAdd(hn::Set(d, 0.00966637F * kScale), x, hn::Set(d, 0.05592198F * kScale));
  y = hn::MulAdd(y, x, hn::Set(d, 0.24022349F * kScale));
  y = hn::MulAdd(y, x, hn::Set(d, 0.69312105F * kScale));
  y = hn::MulAdd(y, x, hn::Set(d, kScale));
  return hn::BitCast(d, hn::Add(hn::BitCast(di, y), hn::ShiftLeft<23>(hn::BitCast(di, sum))));
}

/// Where and how large alpha is: alpha = 2^(f p) / 255.
struct Reach {
  V f, p;
  M hit;
};

/// Pixel positions of the vector: X from the middle of the tile, row from its top.
struct Lanes {
  V x, row;
  int cell_row, first;  ///< First row of the cell; first entry of the vector in the cell.
};

/// Lanes of the vector that starts at entry `first` of the cell.
HWY_INLINE Lanes lanes_of(int cell, int first) {
  const Floats d;
  const int column = cell / kCellsPerRow * kCellPx, row = cell % kCellsPerRow * kCellPx;
  return {
      hn::Add(hn::Set(d, static_cast<float>(column) - 7.5F), hn::Load(d, kLaneColumn + first)),
      hn::Add(hn::Set(d, static_cast<float>(row) + 0.5F), hn::Load(d, kLaneRow + first)), row,
      first};
}

HWY_INLINE Reach reach_with_care(const ScreenSurfel& s, const TilePair& pair, const Lanes& at,
                                 float y_px) {
  const Floats d;
  const V dx = hn::Add(at.x, hn::Set(d, pair.dx));
  const V dy = hn::Add(at.row, hn::Set(d, y_px - s.y0_px));
  const V q_u = hn::MulAdd(hn::Set(d, s.m00), dx, hn::Mul(hn::Set(d, s.m01), dy));
  const V q_v = hn::MulAdd(hn::Set(d, s.m10), dx, hn::Mul(hn::Set(d, s.m11), dy));
  const V e = hn::NegMulAdd(hn::Set(d, s.g0), dx,
                            hn::NegMulAdd(hn::Set(d, s.g1), dy, hn::Set(d, 1.0F)));
  // Outside [e_min, e_max] the plane is nearer than the near plane or beyond the disc, so that
  // only the low pass can hit.
  const M on_disc = hn::And(hn::Ge(e, hn::Set(d, s.e_min)), hn::Le(e, hn::Set(d, s.e_max)));
  const V inverse_e = inverse_of(hn::Max(e, hn::Set(d, s.e_min)));
  const V q2 = hn::MulAdd(q_u, q_u, hn::Mul(q_v, q_v));
  const V c_k2 = hn::Set(d, s.c_k2);
  const V disc =
      hn::Mul(c_k2, hn::NegMulAdd(q2, hn::Mul(inverse_e, inverse_e), hn::Set(d, 1.0F)));
  const V offset2 = hn::MulAdd(dx, dx, hn::Mul(dy, dy));
  const V low_pass = hn::NegMulAdd(offset2, hn::Set(d, kLog2E), c_k2);
  const V exponent = hn::IfThenElse(on_disc, hn::Max(disc, low_pass), low_pass);
  return {exponent, hn::Set(d, 1.0F), hn::Ge(exponent, hn::Zero(d))};
}

/// The rules of compat_rules.h: no clamp of e, a low pass with a centre of its own, and either
/// no fragment before the near plane or none dropped.
HWY_INLINE Reach reach_in_compat(const ScreenSurfel& s, const TilePair& pair, const Lanes& at,
                                 float y_px) {
  const Floats d;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.0F);
  const V dx = hn::Add(at.x, hn::Set(d, pair.dx));
  const V dy = hn::Add(at.row, hn::Set(d, y_px - s.y0_px));
  const V q_u = hn::MulAdd(hn::Set(d, s.m00), dx, hn::Mul(hn::Set(d, s.m01), dy));
  const V q_v = hn::MulAdd(hn::Set(d, s.m10), dx, hn::Mul(hn::Set(d, s.m11), dy));
  const V e = hn::NegMulAdd(hn::Set(d, s.g0), dx, hn::NegMulAdd(hn::Set(d, s.g1), dy, one));
  M drawn = hn::Ne(e, zero);
  const V inverse_e = hn::Div(one, hn::IfThenElse(drawn, e, one));
  if (s.shape == SurfelShape::kInria) {
    const V nearest = hn::Mul(e, hn::Set(d, kCompatNearM));
    drawn = hn::And(hn::Gt(e, zero), hn::Le(nearest, hn::Set(d, s.z0_m)));
  }
  const V u = hn::Mul(q_u, inverse_e), v = hn::Mul(q_v, inverse_e);
  const V c_k2 = hn::Set(d, s.c_k2);
  const V disc = hn::Mul(c_k2, hn::NegMulAdd(u, u, hn::NegMulAdd(v, v, one)));
  const V x = hn::Sub(dx, hn::Set(d, s.e_min)), y = hn::Sub(dy, hn::Set(d, s.e_max));
  const V low_pass = hn::NegMulAdd(hn::MulAdd(x, x, hn::Mul(y, y)), hn::Set(d, kLog2E), c_k2);
  const V exponent = hn::IfThenElse(hn::Gt(disc, low_pass), disc, low_pass);
  return {exponent, one, hn::And(drawn, hn::Ge(exponent, zero))};
}

HWY_INLINE Reach reach_of(const TileChunk& chunk, std::uint32_t i, const Lanes& at,
                          float y_px) {
  const Floats d;
  const TilePair& pair = chunk.pair[i];
  const V x = at.x;
  const V f =
      hn::MulAdd(hn::MulAdd(hn::Set(d, pair.a), x, rows_of(pair.b + at.cell_row, at.first)), x,
                 rows_of(pair.c + at.cell_row, at.first));
  const V p0 = rows_of(pair.p0 + at.cell_row, at.first);
  if (HWY_LIKELY(pair.kind == PairKind::kPlain)) {
    const V p = hn::MulAdd(hn::MulAdd(rows_of(pair.p2 + at.cell_row, at.first), x,
                                      rows_of(pair.p1 + at.cell_row, at.first)),
                           x, p0);
    return {f, p, hn::Ge(f, hn::Zero(d))};
  }
  if (pair.kind == PairKind::kCare) {
    const ScreenSurfel& s = *chunk.screen[i];
    return s.shape > SurfelShape::kCare ? reach_in_compat(s, pair, at, y_px)
                                        : reach_with_care(s, pair, at, y_px);
  }
  V p;
  if (pair.kind == PairKind::kThinParabola) {
    p = hn::MulAdd(hn::MulAdd(rows_of(pair.p2 + at.cell_row, at.first), x,
                              rows_of(pair.p1 + at.cell_row, at.first)),
                   x, p0);
  } else {
    const V inverse_e = inverse_of(hn::NegMulAdd(hn::Set(d, pair.g0), x, p0));
    p = hn::Mul(hn::Mul(inverse_e, inverse_e), hn::Set(d, pair.c_k2));
  }
  if (pair.kind == PairKind::kExact) return {f, p, hn::Ge(f, hn::Zero(d))};
  // Off the disc p may be anything.
  const V low_pass =
      hn::MulAdd(hn::MulAdd(hn::Set(d, -kLog2E), x, hn::Set(d, pair.low_pass_b)), x,
                 rows_of(pair.low_pass_c + at.cell_row, at.first));
  const M on_disc = hn::Ge(f, hn::Zero(d));
  const V exponent = hn::IfThenElse(on_disc, hn::Max(hn::Mul(f, p), low_pass), low_pass);
  return {exponent, hn::Set(d, 1.0F), hn::Ge(exponent, hn::Zero(d))};
}

/// Depth of the surfel's plane at the pixels, within the disc's range.
HWY_INLINE V depth_at(const ScreenSurfel& s, const TilePair& pair, const Lanes& at,
                      float y_px) {
  const Floats d;
  const V dx = hn::Add(at.x, hn::Set(d, pair.dx));
  const V dy = hn::Add(at.row, hn::Set(d, y_px - s.y0_px));
  const V e = hn::NegMulAdd(hn::Set(d, s.g0), dx,
                            hn::NegMulAdd(hn::Set(d, s.g1), dy, hn::Set(d, 1.0F)));
  if (s.shape == SurfelShape::kInria) return hn::Div(hn::Set(d, s.z0_m), e);
  if (s.shape == SurfelShape::kGsplat) return hn::Set(d, s.z0_m);
  const V bounded = hn::Min(hn::Max(e, hn::Set(d, s.e_min)), hn::Set(d, s.e_max));
  return hn::Div(hn::Set(d, s.z0_m), bounded);
}

/// A key (selection_key.h) with the lower bits as they are, as a float.
HWY_INLINE V key_of(V weight, hn::Vec<Keys> low_bits) {
  const Keys dk;
  const auto shifted = hn::ShiftLeft<kKeyShift>(hn::BitCast(dk, weight));
  return hn::BitCast(Floats(), hn::OrAnd(low_bits, shifted, hn::Set(dk, kKeyWeightMask)));
}

/// Adds weight * feature, channel by channel.
template <std::size_t kSize>
HWY_INLINE void add_features(float weight, const std::array<float, kSize>& feature,
                             float* sums) {
  const hn::CappedTag<float, core::kSemanticFeatureSize> d;
  for (std::size_t c = 0; c < kSize; c += hn::Lanes(d)) {
    hn::StoreU(hn::MulAdd(hn::Set(d, weight), hn::LoadU(d, feature.data() + c),
                          hn::LoadU(d, sums + c)),
               d, sums + c);
  }
}

/// A vector of pixels in registers. Keys are compared as floats, whose order for positive
/// numbers is that of their bits: float minima run on more ports.
///
/// `running` is the product of all 1 - alpha, those past the stop included. It only falls, so
/// that a pixel is finished exactly where it is below the stop, and the loop needs no branch
/// that data decide: hits and ends come too irregularly to be foreseen. `transmittance` is
/// what counts: the last value that was not below the stop.
template <bool kRgb, bool kNormal, int kKeys>
struct Pixels {
  V running, transmittance, depth, r, g, b, nx, ny, nz;
  hn::Vec<Keys> front;       ///< TileState::front.
  hn::Vec<Keys> hits;        ///< Contributions so far.
  V key0, key1, key2, key3;  ///< Not an array: they would stay in memory.

  HWY_INLINE void load(const RasterJob& job, const TileState& state, std::size_t p) {
    const Floats d;
    const Keys dk;
    running = hn::Load(d, &state.running[p]);
    transmittance = hn::Load(d, &state.transmittance[p]);
    hits = hn::Zero(dk);
    front = hn::Zero(dk);
    depth = hn::Zero(d);
    if (job.median_depth) {
      front = hn::Load(dk, &state.front[p]);
    } else {
      depth = hn::Load(d, &state.depth[p]);
    }
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
      key0 = hn::BitCast(d, hn::Load(dk, &state.keys[0][p]));
      key1 = hn::BitCast(d, hn::Load(dk, &state.keys[1][p]));
      key2 = hn::BitCast(d, hn::Load(dk, &state.keys[2][p]));
      key3 = hn::BitCast(d, hn::Load(dk, &state.keys[3][p]));
    }
  }

  HWY_INLINE void store(const RasterJob& job, TileState& state, std::size_t p) const {
    const Floats d;
    const Keys dk;
    hn::Store(running, d, &state.running[p]);
    hn::Store(transmittance, d, &state.transmittance[p]);
    if (job.median_depth) {
      hn::Store(front, dk, &state.front[p]);
    } else {
      hn::Store(depth, d, &state.depth[p]);
    }
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
      hn::Store(hn::BitCast(dk, key0), dk, &state.keys[0][p]);
      hn::Store(hn::BitCast(dk, key1), dk, &state.keys[1][p]);
      hn::Store(hn::BitCast(dk, key2), dk, &state.keys[2][p]);
      hn::Store(hn::BitCast(dk, key3), dk, &state.keys[3][p]);
    }
  }

  /// False if all pixels are finished. To be called before products of a batch underflow.
  [[nodiscard]] HWY_INLINE bool clear_finished(const RasterJob& job) {
    const Floats d;
    const M live = hn::Ge(running, hn::Set(d, job.stop_transmittance));
    running = hn::IfThenElseZero(live, running);
    return !hn::AllFalse(d, live);
  }
  HWY_INLINE void finish_all() { running = hn::Zero(Floats()); }

  [[nodiscard]] HWY_INLINE bool half_open() const {
    const Floats d;
    return !hn::AllFalse(d, hn::Gt(running, hn::Set(d, 1.0F - kMinSurfaceAlpha)));
  }

  /// May a later surfel still enter the Top-K of some pixel? After clear_finished().
  [[nodiscard]] HWY_INLINE bool keys_open(const RasterJob& job, const TileState& state,
                                          std::size_t p) const {
    const Floats d;
    V lightest;
    if constexpr (kKeys == kRegisterKeys) {
      lightest = key3;
    } else {
      if (job.all_surfels) return true;
      lightest = hn::BitCast(d, hn::Load(Keys(), &state.keys[job.top_k - 1][p]));
      if (job.first_hits) {
        const M live = hn::Gt(running, hn::Zero(d));
        return !hn::AllFalse(d, hn::And(live, hn::Eq(lightest, hn::Zero(d))));
      }
    }
    const V best_later = hn::Mul(running, hn::Set(d, kMaxAlpha));
    return !hn::AllFalse(d, hn::Gt(key_of(best_later, hn::Zero(Keys())), lightest));
  }

  /// All surfels count: remembers the pixels that were hit, and adds the surfel's features to
  /// theirs.
  HWY_INLINE static void take_all(V weight, std::uint32_t slot, const RasterJob& job,
                                  TileState& state, std::size_t p) {
    const Floats d;
    alignas(64) float weights[kCellPixels];
    hn::Store(weight, d, weights);
    const std::uint32_t surfel = job.projected.shade[slot].surfel;
    for (std::uint64_t bits = bits_of(hn::Gt(weight, hn::Zero(d))); bits != 0;
         bits &= bits - 1) {
      const int lane = std::countr_zero(bits);
      const std::size_t pixel = row_major(p + static_cast<std::size_t>(lane));
      if (job.logs_labels) {
        state.all->log.push_back({weights[lane], slot, static_cast<std::uint32_t>(pixel)});
      }
      if (job.sums_features) {
        const SurfelCloud& cloud = *job.resolve->cloud;
        float* sums = &state.all->sums[pixel * kFeatureChannels];
        add_features(weights[lane], cloud.semantic_feature[surfel], sums);
        add_features(weights[lane], cloud.instance_feature[surfel],
                     sums + core::kSemanticFeatureSize);
        ++state.all->rows_read;
      }
    }
  }

  HWY_INLINE void insert_key(V weight, const TileChunk& chunk, std::uint32_t i,
                             const RasterJob& job, TileState& state, std::size_t p) {
    const Floats d;
    const Keys dk;
    if constexpr (kKeys != kRegisterKeys) {
      if (job.all_surfels) {
        take_all(weight, chunk.slot[i], job, state, p);
        return;
      }
    }
    // Without weight this is no key, but smaller than all that are.
    V key = key_of(weight, hn::Set(dk, chunk.pair[i].key_position));
    if constexpr (kKeys == kRegisterKeys) {
      const V after0 = hn::Min(key0, key);
      key0 = hn::Max(key0, key);
      const V after1 = hn::Min(key1, after0);
      key1 = hn::Max(key1, after0);
      const V after2 = hn::Min(key2, after1);
      key2 = hn::Max(key2, after1);
      key3 = hn::Max(key3, after2);
    } else {
      const V lightest = hn::BitCast(d, hn::Load(dk, &state.keys[job.top_k - 1][p]));
      M enters = hn::And(hn::Gt(weight, hn::Zero(d)), hn::Gt(key, lightest));
      if (job.first_hits) enters = hn::And(enters, hn::Eq(lightest, hn::Zero(d)));
      if (hn::AllFalse(d, enters)) return;
      key = hn::IfThenElseZero(enters, key);
      for (int k = 0; k < job.top_k; ++k) {
        const V present = hn::BitCast(d, hn::Load(dk, &state.keys[k][p]));
        hn::Store(hn::BitCast(dk, hn::Max(present, key)), dk, &state.keys[k][p]);
        key = hn::Min(present, key);
      }
    }
  }

  /// Blends one surfel into the pixels that it hits; finishes those that it would saturate.
  template <bool kDepthOpen, bool kKeysOpen>
  HWY_INLINE void blend(const RasterJob& job, const TileChunk& chunk, std::uint32_t i,
                        const Lanes& at, float y_px, TileState& state, std::size_t p) {
    const Floats d;
    const Keys dk;
    const TilePair& pair = chunk.pair[i];
    const Reach reach = reach_of(chunk, i, at, y_px);
    const V alpha = hn::IfThenElseZero(
        reach.hit, hn::Min(alpha_of(reach.f, reach.p), hn::Set(d, kMaxAlpha)));
    const V before = running;
    running = hn::NegMulAdd(alpha, before, before);
    const M counts = hn::And(reach.hit, hn::Ge(running, hn::Set(d, job.stop_transmittance)));
    const V weight = hn::IfThenElseZero(counts, hn::Mul(alpha, before));
    transmittance = hn::IfThenElse(counts, running, transmittance);
    hits = hn::Sub(hits, hn::VecFromMask(dk, hn::RebindMask(dk, counts)));  // A mask is -1.
    if constexpr (kDepthOpen) {
      if (job.median_depth) {
        // The last surfel that finds more than half left is the one that takes it.
        const M open = hn::Gt(before, hn::Set(d, 1.0F - kMinSurfaceAlpha));
        front =
            hn::IfThenElse(hn::RebindMask(dk, open), hn::Set(dk, pair.list_position), front);
      } else {
        const V here = hn::IfThenElseZero(counts, depth_at(*chunk.screen[i], pair, at, y_px));
        depth = hn::MulAdd(weight, here, depth);
      }
    }
    if constexpr (kRgb) {
      r = hn::MulAdd(weight, hn::Set(d, pair.shade.r), r);
      g = hn::MulAdd(weight, hn::Set(d, pair.shade.g), g);
      b = hn::MulAdd(weight, hn::Set(d, pair.shade.b), b);
    }
    if constexpr (kNormal) {
      nx = hn::MulAdd(weight, hn::Set(d, pair.shade.nx), nx);
      ny = hn::MulAdd(weight, hn::Set(d, pair.shade.ny), ny);
      nz = hn::MulAdd(weight, hn::Set(d, pair.shade.nz), nz);
    }
    if constexpr (kKeysOpen) insert_key(weight, chunk, i, job, state, p);
  }
};

/// Up to kBatch surfels of `todo`.
template <bool kDepthOpen, bool kKeysOpen, class PixelVector>
HWY_INLINE void blend_batch(const RasterJob& job, const TileChunk& chunk, std::uint64_t& todo,
                            const Lanes& at, float y_px, PixelVector& pixels, TileState& state,
                            std::size_t p) {
  for (int n = 0; n < kBatch && todo != 0; ++n) {
    const auto i = static_cast<std::uint32_t>(std::countr_zero(todo));
    todo &= todo - 1;
    pixels.template blend<kDepthOpen, kKeysOpen>(job, chunk, i, at, y_px, state, p);
  }
}

/// Blends the surfels in `todo` (bits of the chunk) into vector `vector` of a cell.
/// @return  False if all its pixels are finished.
template <bool kRgb, bool kNormal, int kKeys>
bool blend_cell(const RasterJob& job, const TileChunk& chunk, std::uint64_t todo, int cell,
                int first, float y_px, TileState& state, TileStats& stats) {
  const Floats d;
  const std::size_t p = static_cast<std::size_t>(cell) * kCellPixels + first;
  Pixels<kRgb, kNormal, kKeys> pixels;
  pixels.load(job, state, p);
  const Lanes at = lanes_of(cell, first);
  bool depth_open = job.wants_depth;
  bool keys_open = kKeys > 0;
  bool any_live = true;
  stats.evaluations += static_cast<std::uint64_t>(std::popcount(todo)) * hn::Lanes(d);
  while (todo != 0) {
    any_live = pixels.clear_finished(job);
    const bool half_open = pixels.half_open();
    if (job.median_depth) depth_open = depth_open && half_open;
    if constexpr (kKeys > 0) keys_open = keys_open && pixels.keys_open(job, state, p);
    if (job.labels_only && !keys_open && !half_open) {
      pixels.finish_all();
      any_live = false;
    }
    if (!any_live) break;
    if (depth_open) {
      blend_batch<true, (kKeys > 0)>(job, chunk, todo, at, y_px, pixels, state, p);
    } else if (keys_open) {
      blend_batch<false, (kKeys > 0)>(job, chunk, todo, at, y_px, pixels, state, p);
    } else {
      blend_batch<false, false>(job, chunk, todo, at, y_px, pixels, state, p);
    }
  }
  stats.evaluations -= static_cast<std::uint64_t>(std::popcount(todo)) * hn::Lanes(d);
  stats.contributions += hn::GetLane(hn::SumOfLanes(Keys(), pixels.hits));
  if (any_live) any_live = pixels.clear_finished(job);
  pixels.store(job, state, p);
  return any_live;
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer::internal
HWY_AFTER_NAMESPACE();

#endif  // per target
