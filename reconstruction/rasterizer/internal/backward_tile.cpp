#include <bit>
#include <cstdint>

#include "core/process/kernel_choice.h"
#include "reconstruction/rasterizer/internal/plain_tile.h"
#include "reconstruction/rasterizer/internal/training_tile.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruction/rasterizer/internal/backward_tile.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

// clang-format off: each target includes it again.
#include "reconstruction/rasterizer/internal/tile_hit-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace segsim::reconstruction::internal::training {
namespace HWY_NAMESPACE {

/// PixelAdjoint of a tile: what changes from surfel to surfel.
struct Running {
  alignas(64) float transmittance[kRecordPixels], remaining[kRecordPixels];
};

/// LocalGradient, one partial sum a lane.
struct LaneGradient {
  V m00, m01, m10, m11, g0, g1, x0, y0, z0, reach, log_opacity;
  V r, g, b, nx, ny, nz;
};

HWY_INLINE LaneGradient no_gradient() {
  const V zero = hn::Zero(Floats());
  return {zero, zero, zero, zero, zero, zero, zero, zero, zero,
          zero, zero, zero, zero, zero, zero, zero, zero};
}

HWY_INLINE float sum_of(V lanes) { return hn::GetLane(hn::SumOfLanes(Floats(), lanes)); }

HWY_INLINE LocalGradient<float> sum_of(const LaneGradient& s) {
  return {sum_of(s.m00),
          sum_of(s.m01),
          sum_of(s.m10),
          sum_of(s.m11),
          sum_of(s.g0),
          sum_of(s.g1),
          sum_of(s.x0),
          sum_of(s.y0),
          sum_of(s.z0),
          sum_of(s.reach),
          sum_of(s.log_opacity),
          {sum_of(s.r), sum_of(s.g), sum_of(s.b)},
          {sum_of(s.nx), sum_of(s.ny), sum_of(s.nz)}};
}

/// As HitGradient; 0 in lanes where nothing was blended.
struct HitGradients {
  V alpha, depth_m;
};

/// The part of add_hit_gradient() through the depth.
/// @return  By e.
HWY_INLINE V add_depth_gradient(const DrawnSurfel<float>& s, const Hits& h, V by_depth,
                                LaneGradient& sum) {
  const M limited = hn::Ne(h.e, h.e_drawn);
  const V by_z0 = hn::Mul(by_depth, h.inverse_e);
  const V by_e = hn::Neg(hn::Mul(hn::Mul(by_z0, h.inverse_e), set(s.z0_m)));
  if (none(limited)) {
    sum.z0 = hn::Add(sum.z0, by_z0);
    return by_e;
  }
  const M far = hn::Lt(h.e, set(s.e_min)), near = hn::Gt(h.e, set(s.e_max));
  const V by_reach = hn::Mul(by_depth, set(s.z0_m));
  if (s.e_max == s.e_near) {
    sum.z0 = hn::Add(sum.z0, hn::IfThenZeroElse(near, by_z0));
  } else {
    sum.z0 = hn::Add(sum.z0, by_z0);
    sum.reach = hn::Sub(sum.reach, hn::IfThenElseZero(near, by_reach));
  }
  sum.reach = hn::Add(sum.reach, hn::IfThenElseZero(far, by_reach));
  return hn::IfThenZeroElse(limited, by_e);
}

/// The rest of it but for colour and normal.
HWY_INLINE void add_gradient(const DrawnSurfel<float>& s, const Hits& h,
                             const HitGradients& by, LaneGradient& sum) {
  V by_e = add_depth_gradient(s, h, by.depth_m, sum);
  const V by_log_alpha = hn::IfThenZeroElse(h.opaque, hn::Mul(by.alpha, h.alpha));
  sum.log_opacity = hn::Add(sum.log_opacity, by_log_alpha);
  const V by_rho = hn::Mul(by_log_alpha, set(-0.5F));
  const V by_rho_disc = hn::IfThenZeroElse(h.low_pass, by_rho);
  const V twice = hn::Mul(hn::Add(by_rho_disc, by_rho_disc), h.inverse_e);
  by_e = hn::NegMulAdd(twice, h.rho, by_e);
  const V scale = hn::Mul(twice, h.inverse_e);
  const V by_q0 = hn::Mul(scale, h.q0), by_q1 = hn::Mul(scale, h.q1);
  sum.m00 = hn::MulAdd(by_q0, h.dx, sum.m00);
  sum.m01 = hn::MulAdd(by_q0, h.dy, sum.m01);
  sum.m10 = hn::MulAdd(by_q1, h.dx, sum.m10);
  sum.m11 = hn::MulAdd(by_q1, h.dy, sum.m11);
  sum.g0 = hn::NegMulAdd(by_e, h.dx, sum.g0);
  sum.g1 = hn::NegMulAdd(by_e, h.dy, sum.g1);
  V by_x0 = hn::MulSub(by_e, set(s.g0), hn::Mul(set(s.m00), by_q0));
  V by_y0 = hn::MulSub(by_e, set(s.g1), hn::Mul(set(s.m01), by_q0));
  by_x0 = hn::NegMulAdd(set(s.m10), by_q1, by_x0);
  by_y0 = hn::NegMulAdd(set(s.m11), by_q1, by_y0);
  if (!none(h.low_pass)) {
    const V four = hn::Mul(hn::IfThenElseZero(h.low_pass, by_rho), set(4.0F));
    by_x0 = hn::NegMulAdd(four, h.dx, by_x0);
    by_y0 = hn::NegMulAdd(four, h.dy, by_y0);
  }
  sum.x0 = hn::Add(sum.x0, by_x0);
  sum.y0 = hn::Add(sum.y0, by_y0);
}

/// Takes one surfel out of the pixels of one vector: unblend_hit() and add_hit_gradient().
/// @param weight_loss  Derivatives of those pixels by the weight; read if kWeights.
template <bool kDistortion, bool kWeights>
HWY_INLINE void unblend(const DrawnSurfel<float>& s, std::uint32_t entry,
                        const PixelCentres& centres, const TileRecord<float>& record,
                        const TileLoss<float>& loss, const float* weight_loss, int p,
                        Running& running, LaneGradient& sum) {
  const Floats d;
  const Ints di;
  const hn::RebindToUnsigned<Floats> du;
  Hits h = meet(s, load(&centres.x_px[p]), load(&centres.y_px[p]));
  const auto end = hn::BitCast(di, hn::Load(du, &record.end[p]));
  const M blended = hn::And(
      h.hit, hn::RebindMask(d, hn::Lt(hn::Set(di, static_cast<std::int32_t>(entry)), end)));
  if (none(blended)) return;
  h.low_pass = hn::And(h.low_pass, blended);
  const V transmittance = load(&running.transmittance[p]);
  const V product = hn::IfThenElseZero(blended, hn::Mul(transmittance, h.alpha));
  const V depth_m = hn::Mul(set(s.z0_m), h.inverse_e);
  const V by_r = load(&loss.r[p]), by_g = load(&loss.g[p]), by_b = load(&loss.b[p]);
  const V by_nx = load(&loss.nx[p]), by_ny = load(&loss.ny[p]), by_nz = load(&loss.nz[p]);
  V by_depth = load(&loss.depth_m[p]);
  V value = hn::MulAdd(by_depth, depth_m, load(&loss.alpha[p]));
  value = hn::MulAdd(by_r, set(s.colour.x), value);
  value = hn::MulAdd(by_g, set(s.colour.y), value);
  value = hn::MulAdd(by_b, set(s.colour.z), value);
  value = hn::MulAdd(by_nx, set(s.normal.x), value);
  value = hn::MulAdd(by_ny, set(s.normal.y), value);
  value = hn::MulAdd(by_nz, set(s.normal.z), value);
  if constexpr (kWeights) value = hn::Add(value, hn::LoadU(d, weight_loss));
  if constexpr (kDistortion) {
    const V inverse_depth = hn::Mul(h.e_drawn, set(1.0F / s.z0_m));
    const V alpha_all = hn::Sub(set(1.0F), load(&record.transmittance[p]));
    const V m1 = load(&record.m1[p]), by_distortion = load(&loss.distortion[p]);
    const V m = hn::Mul(set(static_cast<float>(kDistortionScale)),
                        hn::Sub(load(&record.first_inverse_depth[p]), inverse_depth));
    const V am = hn::Mul(alpha_all, m);
    const V by_weight = hn::MulAdd(m, hn::NegMulAdd(set(2.0F), m1, am), load(&record.m2[p]));
    value = hn::MulAdd(by_distortion, by_weight, value);
    const V by_m = hn::Mul(by_distortion, hn::Sub(am, m1));
    by_depth = hn::MulAdd(hn::Mul(by_m, set(static_cast<float>(2.0 * kDistortionScale))),
                          hn::Mul(inverse_depth, inverse_depth), by_depth);
  }
  const V remaining = hn::NegMulAdd(product, value, load(&running.remaining[p]));
  hn::Store(remaining, d, &running.remaining[p]);
  hn::Store(hn::Sub(transmittance, product), d, &running.transmittance[p]);
  const V by_alpha = hn::NegMulAdd(remaining, inverse_of(hn::Sub(set(1.0F), h.alpha)),
                                   hn::Mul(transmittance, value));
  sum.r = hn::MulAdd(product, by_r, sum.r);
  sum.g = hn::MulAdd(product, by_g, sum.g);
  sum.b = hn::MulAdd(product, by_b, sum.b);
  sum.nx = hn::MulAdd(product, by_nx, sum.nx);
  sum.ny = hn::MulAdd(product, by_ny, sum.ny);
  sum.nz = hn::MulAdd(product, by_nz, sum.nz);
  add_gradient(s, h, {hn::IfThenElseZero(blended, by_alpha), hn::Mul(product, by_depth)}, sum);
}

template <bool kDistortion, bool kWeights>
void backward_with(const TileView<float>& tile, const TileRecord<float>& record,
                   const std::uint16_t* cells, const TileLoss<float>& loss,
                   const TileWeightLoss<float>* weights, LocalGradient<float>* gradients) {
  const PixelCentres centres(tile.x_px, tile.y_px);
  Running running;
  for (int p = 0; p < kRecordPixels; ++p) {
    running.transmittance[p] = 1.0F;
    running.remaining[p] = remaining_value(loss.at(p), record.sums(p), PixelSums<float>{});
    if constexpr (kWeights) {
      running.remaining[p] += weights->remaining[static_cast<std::size_t>(p)];
    }
  }
  const float* by_weight = kWeights ? weights->by_weight.data() : nullptr;
  const int step = static_cast<int>(hn::Lanes(Floats()));
  for (std::uint32_t i = 0; i < tile.list.size(); ++i) {
    prefetch(tile, i + kAhead);
    if (cells[i] == 0) continue;
    const DrawnSurfel<float>& s = tile.surfels[tile.list[i]].drawn;
    LaneGradient sum = no_gradient();
    for (unsigned left = cells[i]; left != 0; left &= left - 1) {
      const int first = std::countr_zero(left) * kCellSize;
      for (int p = first; p < first + kCellSize; p += step) {
        unblend<kDistortion, kWeights>(s, i, centres, record, loss, by_weight, p, running,
                                       sum);
        if constexpr (kWeights) by_weight += step;
      }
    }
    *gradients++ = sum_of(sum);
  }
}

void backward(const TileView<float>& tile, const TileRecord<float>& record,
              const std::uint16_t* cells, const TileLoss<float>& loss,
              const TileWeightLoss<float>* weights, LocalGradient<float>* gradients) {
  bool distortion = false;
  for (const float by : loss.distortion) distortion = distortion || by != 0.0F;
  const auto with = [&]<bool kWeights>() {
    if (distortion) {
      backward_with<true, kWeights>(tile, record, cells, loss, weights, gradients);
    } else {
      backward_with<false, kWeights>(tile, record, cells, loss, weights, gradients);
    }
  };
  if (weights != nullptr) {
    with.template operator()<true>();
  } else {
    with.template operator()<false>();
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::reconstruction::internal::training
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace segsim::reconstruction::internal {
namespace training {
namespace {
HWY_EXPORT(backward);

/// A sum over the lanes of a vector depends on how many there are. So runs that are to be
/// reproducible add as AVX2 does, which all their processors have.
[[nodiscard]] auto backward_of_run() {
#if HWY_TARGETS & HWY_AVX2
  static const bool held = core::kernel_choice() == core::KernelChoice::kReproducible;
  if (held) return &N_AVX2::backward;
#endif
  return &HWY_DYNAMIC_DISPATCH(backward);
}
}  // namespace
}  // namespace training

void backward_tile(const TileView<float>& tile, const TileRecord<float>& record,
                   const std::uint16_t* cells, const TileLoss<float>& loss,
                   const TileWeightLoss<float>* weights, LocalGradient<float>* gradients) {
  training::backward_of_run()(tile, record, cells, loss, weights, gradients);
}

void backward_tile(const TileView<double>& tile, const TileRecord<double>& record,
                   const std::uint16_t* cells, const TileLoss<double>& loss,
                   const TileWeightLoss<double>* weights, LocalGradient<double>* gradients) {
  plain_backward_tile(tile, record, cells, loss, weights, gradients);
}

}  // namespace segsim::reconstruction::internal
#endif  // HWY_ONCE
