#include "renderer/internal/projection.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include <glm/geometric.hpp>

#include "renderer/internal/surfel_tiles.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/internal/projection.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SEGSIM_RENDERER_PROJECTION_ONCE
#define SEGSIM_RENDERER_PROJECTION_ONCE
namespace segsim::renderer::internal {
namespace {

/// Rounding of the projected centre and outline stays below this [px].
constexpr float kPixelSlack = 1e-3F;
/// Rounding of a row interval [px].
constexpr float kSpanSlackPx = 2e-3F;
constexpr float kHalfLog2E = 0.72134752F;
/// A surfel thinner than about 0.2 px per sigma is not squared; see tile_chunk-inl.h.
constexpr float kMaxInverseNorm2 = 25.0F;
/// Tile rows that a short vector takes at once.
constexpr int kFewRows = 4;
/// Columns of the block that hands lanes from the vector code to emit_surfel().
constexpr std::size_t kMaxLanes = 16;

/// Lanes of one step, one row a quantity.
struct ProjectedLanes {
  alignas(64) float x0[kMaxLanes], y0[kMaxLanes], z0[kMaxLanes];
  alignas(64) float m00[kMaxLanes], m01[kMaxLanes], m10[kMaxLanes], m11[kMaxLanes];
  alignas(64) float g0[kMaxLanes], g1[kMaxLanes];
  alignas(64) float e_min[kMaxLanes], e_max[kMaxLanes];
  alignas(64) float cx[kMaxLanes], cy[kMaxLanes];
  alignas(64) float sxx[kMaxLanes], sxy[kMaxLanes], syy[kMaxLanes];
  alignas(64) float x_lo[kMaxLanes], x_hi[kMaxLanes], y_lo[kMaxLanes], y_hi[kMaxLanes];
  std::uint64_t drawn = 0, thin = 0, care = 0, clipped = 0;  ///< One bit a lane.
};

glm::vec3 colour_of(const ProjectionJob& job, std::size_t i) {
  if (!job.packed.colour.empty()) return job.packed.colour[i];
  const Vec3<float>& eye = job.camera.centre_m;
  const glm::vec3 direction = glm::normalize(glm::vec3(
      job.packed.x_m[i] - eye.x, job.packed.y_m[i] - eye.y, job.packed.z_m[i] - eye.z));
  float basis[16];
  sh_basis(job.cloud.sh_degree, Vec3<float>{direction.x, direction.y, direction.z}, basis);
  const std::size_t n = job.cloud.sh_count();
  const glm::vec3* sh = job.cloud.sh.data() + job.packed.surfel[i] * n;
  glm::vec3 sum(0.5F);
  for (std::size_t k = 0; k < n; ++k) sum += basis[k] * sh[k];
  return glm::max(sum, glm::vec3(0.0F));
}

SurfelShade shade_of(const ProjectionJob& job, std::size_t i) {
  const PackedSurfels& packed = job.packed;
  const Vec3<float>& eye = job.camera.centre_m;
  glm::vec3 normal = packed.normal[i];
  const glm::vec3 ray(packed.x_m[i] - eye.x, packed.y_m[i] - eye.y, packed.z_m[i] - eye.z);
  if (glm::dot(normal, ray) > 0.0F) normal = -normal;
  const glm::vec3 colour = job.colours ? colour_of(job, i) : glm::vec3(0.0F);
  return {colour.r, colour.g, colour.b,        normal.x,
          normal.y, normal.z, packed.label[i], packed.surfel[i]};
}

/// First and last pixel whose centre lies in the box, inside the image.
ScreenBox<float> pixel_range(const ScreenBox<float>& box, int width_px, int height_px) {
  return {std::max(std::ceil(box.x_min_px - 0.5F - kPixelSlack), 0.0F),
          std::min(std::floor(box.x_max_px - 0.5F + kPixelSlack),
                   static_cast<float>(width_px - 1)),
          std::max(std::ceil(box.y_min_px - 0.5F - kPixelSlack), 0.0F),
          std::min(std::floor(box.y_max_px - 0.5F + kPixelSlack),
                   static_cast<float>(height_px - 1))};
}

/// The rare surfel that reaches through the near plane.
ScreenBox<float> clipped_pixel_range(const ProjectionJob& job, std::size_t i) {
  const PackedSurfels& p = job.packed;
  const auto s = project_surfel<float>(job.camera, {p.x_m[i], p.y_m[i], p.z_m[i]},
                                       {p.ux_m[i], p.uy_m[i], p.uz_m[i]},
                                       {p.vx_m[i], p.vy_m[i], p.vz_m[i]});
  const float k2 = p.k2[i] * kBoundSlack;
  ScreenBox<float> box = with_low_pass(box_of_clipped_disc(s, k2, job.near_m), s, k2);
  // Offsets can be many thousand pixels here, so float rounding exceeds kPixelSlack.
  const float slack =
      1e-5F * std::max(box.x_max_px - box.x_min_px, box.y_max_px - box.y_min_px);
  box = {box.x_min_px - slack, box.x_max_px + slack, box.y_min_px - slack,
         box.y_max_px + slack};
  return pixel_range(box, job.width_px, job.height_px);
}

/// Writes lane `lane` (packed surfel i) to `slot`; false if it covers no pixel.
/// @param outline  syy < 0: use the pixel range instead.
bool emit_surfel(const ProjectionJob& job, const ProjectedLanes& lanes, std::size_t lane,
                 std::size_t i, std::size_t slot, ProjectedSurfels& out,
                 ScreenEllipse<float>& outline) {
  ScreenBox<float> range{lanes.x_lo[lane], lanes.x_hi[lane], lanes.y_lo[lane],
                         lanes.y_hi[lane]};
  const bool clipped = (lanes.clipped >> lane & 1U) != 0;
  if (clipped) {
    range = clipped_pixel_range(job, i);
    if (!(range.x_min_px <= range.x_max_px && range.y_min_px <= range.y_max_px)) return false;
  }
  ScreenSurfel& screen = out.screen[slot];
  screen = {lanes.x0[lane],
            lanes.y0[lane],
            lanes.m00[lane],
            lanes.m01[lane],
            lanes.m10[lane],
            lanes.m11[lane],
            lanes.g0[lane],
            lanes.g1[lane],
            lanes.z0[lane],
            kHalfLog2E * job.packed.k2[i],
            lanes.e_min[lane],
            lanes.e_max[lane],
            static_cast<std::uint16_t>(range.x_min_px),
            static_cast<std::uint16_t>(range.x_max_px),
            static_cast<std::uint16_t>(range.y_min_px),
            static_cast<std::uint16_t>(range.y_max_px),
            (lanes.care >> lane & 1U) != 0   ? SurfelShape::kCare
            : (lanes.thin >> lane & 1U) != 0 ? SurfelShape::kThin
                                             : SurfelShape::kPlain};
  out.shade[slot] = shade_of(job, i);
  outline = {lanes.cx[lane], lanes.cy[lane], lanes.sxx[lane], lanes.sxy[lane],
             clipped ? -1.0F : lanes.syy[lane]};
  return true;
}

}  // namespace
}  // namespace segsim::renderer::internal
#endif  // SEGSIM_RENDERER_PROJECTION_ONCE

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer::internal {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::CappedTag<float, kMaxLanes>;
using V = hn::Vec<Floats>;

struct V3 {
  V x, y, z;
};

/// Unfused and in this order: see depth_of_centre().
HWY_INLINE V exact_dot(const Vec3<float>& a, const V3& b) {
  const Floats d;
  return hn::Add(hn::Add(hn::Mul(hn::Set(d, a.x), b.x), hn::Mul(hn::Set(d, a.y), b.y)),
                 hn::Mul(hn::Set(d, a.z), b.z));
}

HWY_INLINE V dot2(V a0, V b0, V a1, V b1) { return hn::MulAdd(a0, b0, hn::Mul(a1, b1)); }

HWY_INLINE std::uint64_t bits_of(hn::Mask<Floats> mask) {
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(Floats(), mask, bytes);
  std::uint64_t bits = 0;
  std::memcpy(&bits, bytes, sizeof bits);
  return bits;
}

/// surfel_geometry.h, a vector of surfels at a time, from packed index i on.
HWY_INLINE void project_lanes(const ProjectionJob& job, std::size_t i, ProjectedLanes& out) {
  const Floats d;
  const PackedSurfels& p = job.packed;
  const ProjectionCamera<float>& camera = job.camera;
  const V one = hn::Set(d, 1.0F);
  const V3 offset = {hn::Sub(hn::LoadU(d, &p.x_m[i]), hn::Set(d, camera.centre_m.x)),
                     hn::Sub(hn::LoadU(d, &p.y_m[i]), hn::Set(d, camera.centre_m.y)),
                     hn::Sub(hn::LoadU(d, &p.z_m[i]), hn::Set(d, camera.centre_m.z))};
  const V z0 = exact_dot(camera.forward, offset);
  const V k2 = hn::LoadU(d, &p.k2[i]);
  auto drawn = hn::And(hn::Gt(z0, hn::Set(d, job.near_m)), hn::Gt(k2, hn::Zero(d)));
  out.drawn = 0;
  if (hn::AllFalse(d, drawn)) return;

  const V3 u = {hn::LoadU(d, &p.ux_m[i]), hn::LoadU(d, &p.uy_m[i]), hn::LoadU(d, &p.uz_m[i])};
  const V3 v = {hn::LoadU(d, &p.vx_m[i]), hn::LoadU(d, &p.vy_m[i]), hn::LoadU(d, &p.vz_m[i])};
  const V fx = hn::Set(d, camera.fx_px), fy = hn::Set(d, camera.fy_px);
  const V inverse_z = hn::Div(one, z0);
  const V xn = hn::Mul(exact_dot(camera.right, offset), inverse_z);
  const V yn = hn::Mul(exact_dot(camera.down, offset), inverse_z);
  const V w0 = hn::Mul(exact_dot(camera.forward, u), inverse_z);
  const V w1 = hn::Mul(exact_dot(camera.forward, v), inverse_z);
  const V a0 =
      hn::Mul(fx, hn::NegMulAdd(xn, w0, hn::Mul(exact_dot(camera.right, u), inverse_z)));
  const V a1 =
      hn::Mul(fx, hn::NegMulAdd(xn, w1, hn::Mul(exact_dot(camera.right, v), inverse_z)));
  const V b0 =
      hn::Mul(fy, hn::NegMulAdd(yn, w0, hn::Mul(exact_dot(camera.down, u), inverse_z)));
  const V b1 =
      hn::Mul(fy, hn::NegMulAdd(yn, w1, hn::Mul(exact_dot(camera.down, v), inverse_z)));
  const V x0 = hn::MulAdd(fx, xn, hn::Set(d, camera.cx_px));
  const V y0 = hn::MulAdd(fy, yn, hn::Set(d, camera.cy_px));

  // Outline and its box.
  const V k2_bound = hn::Mul(k2, hn::Set(d, kBoundSlack));
  const V ww = dot2(w0, w0, w1, w1);
  const V kw = hn::Sqrt(hn::Mul(k2_bound, ww));
  const V nu = hn::Mul(hn::Set(d, job.near_m), inverse_z);
  const auto clipped = hn::And(drawn, hn::Lt(hn::Sub(one, kw), nu));
  const V denominator = hn::Max(hn::NegMulAdd(k2_bound, ww, one), hn::Set(d, 1e-6F));
  const V g = hn::Div(k2_bound, denominator);
  const V ox = hn::Mul(g, dot2(a0, w0, a1, w1));
  const V oy = hn::Mul(g, dot2(b0, w0, b1, w1));
  const V aa = dot2(a0, a0, a1, a1);
  const V bb = dot2(b0, b0, b1, b1);
  const V sxx = hn::MulAdd(ox, ox, hn::Mul(g, aa));
  const V sxy = hn::MulAdd(ox, oy, hn::Mul(g, dot2(a0, b0, a1, b1)));
  const V syy = hn::MulAdd(oy, oy, hn::Mul(g, bb));
  const V cx = hn::Sub(x0, ox), cy = hn::Sub(y0, oy);
  const V half_width = hn::Sqrt(sxx), half_height = hn::Sqrt(syy);
  const V low_pass = hn::Sqrt(hn::Mul(k2_bound, hn::Set(d, 0.5F)));
  const V before = hn::Set(d, 0.5F + kPixelSlack), after = hn::Set(d, 0.5F - kPixelSlack);
  const V x_lo = hn::Max(
      hn::Ceil(hn::Sub(hn::Min(hn::Sub(cx, half_width), hn::Sub(x0, low_pass)), before)),
      hn::Zero(d));
  const V x_hi = hn::Min(
      hn::Floor(hn::Sub(hn::Max(hn::Add(cx, half_width), hn::Add(x0, low_pass)), after)),
      hn::Set(d, static_cast<float>(job.width_px - 1)));
  const V y_lo = hn::Max(
      hn::Ceil(hn::Sub(hn::Min(hn::Sub(cy, half_height), hn::Sub(y0, low_pass)), before)),
      hn::Zero(d));
  const V y_hi = hn::Min(
      hn::Floor(hn::Sub(hn::Max(hn::Add(cy, half_height), hn::Add(y0, low_pass)), after)),
      hn::Set(d, static_cast<float>(job.height_px - 1)));
  drawn = hn::And(drawn, hn::Or(clipped, hn::And(hn::Le(x_lo, x_hi), hn::Le(y_lo, y_hi))));
  out.drawn = bits_of(drawn);
  if (out.drawn == 0) return;

  // Inverse map.
  const V det = hn::MulSub(a0, b1, hn::Mul(a1, b0));
  const V norm2 = hn::Add(aa, bb);
  const auto edge_on = hn::Or(hn::Lt(hn::Abs(det), hn::Mul(hn::Set(d, kEdgeOn), norm2)),
                              hn::Eq(det, hn::Zero(d)));
  const V inverse_det = hn::Div(one, det);
  const V inverse_k = hn::Div(one, hn::Sqrt(hn::Max(k2, hn::Set(d, 1e-12F))));
  const V diagonal = hn::Set(d, kEdgeOnInverse);
  const V m00 = hn::IfThenElse(edge_on, diagonal, hn::Mul(b1, inverse_det));
  const V m11 = hn::IfThenElse(edge_on, diagonal, hn::Mul(a0, inverse_det));
  const V m01 = hn::IfThenZeroElse(edge_on, hn::Neg(hn::Mul(a1, inverse_det)));
  const V m10 = hn::IfThenZeroElse(edge_on, hn::Neg(hn::Mul(b0, inverse_det)));
  const V g0 = hn::IfThenZeroElse(edge_on, dot2(w0, m00, w1, m10));
  const V g1 = hn::IfThenZeroElse(edge_on, dot2(w0, m01, w1, m11));

  // low_pass_matters() and inverse_depth_range().
  const V kw1 = hn::Add(one, kw);
  const V t = hn::Mul(hn::Set(d, 0.501F), hn::Mul(kw1, kw1));
  const auto thin = hn::Or(hn::Lt(hn::Mul(det, det), hn::Mul(t, hn::Sub(norm2, t))),
                           hn::Lt(norm2, hn::Add(t, t)));
  // |M|^2 = |J|^2 / det^2 beyond this: pixel offsets lose their digits when squared.
  const auto thread = hn::Gt(norm2, hn::Mul(hn::Mul(det, det), hn::Set(d, kMaxInverseNorm2)));
  out.thin = bits_of(thin);
  out.care = bits_of(hn::Or(hn::Or(thread, clipped), edge_on));
  out.clipped = bits_of(clipped);
  const V e_min = hn::Div(hn::Set(d, 1.0F / kBoundSlack), kw1);
  const V e_max = hn::Div(hn::Set(d, kBoundSlack), hn::Max(hn::Sub(one, kw), nu));

  hn::Store(x0, d, out.x0), hn::Store(y0, d, out.y0), hn::Store(z0, d, out.z0);
  hn::Store(hn::Mul(m00, inverse_k), d, out.m00);
  hn::Store(hn::Mul(m01, inverse_k), d, out.m01);
  hn::Store(hn::Mul(m10, inverse_k), d, out.m10);
  hn::Store(hn::Mul(m11, inverse_k), d, out.m11);
  hn::Store(g0, d, out.g0), hn::Store(g1, d, out.g1);
  hn::Store(e_min, d, out.e_min), hn::Store(e_max, d, out.e_max);
  hn::Store(cx, d, out.cx), hn::Store(cy, d, out.cy);
  hn::Store(sxx, d, out.sxx), hn::Store(sxy, d, out.sxy), hn::Store(syy, d, out.syy);
  hn::Store(x_lo, d, out.x_lo), hn::Store(x_hi, d, out.x_hi);
  hn::Store(y_lo, d, out.y_lo), hn::Store(y_hi, d, out.y_hi);
}

/// Half of the outline's width along the line at `y` from its centre.
template <class D>
HWY_INLINE hn::Vec<D> half_width_at(D d, hn::Vec<D> y, hn::Vec<D> minor,
                                    hn::Vec<D> inverse_syy) {
  using Rows = hn::Vec<D>;
  const Rows inside = hn::NegMulAdd(hn::Mul(y, y), inverse_syy, hn::Set(d, 1.0F));
  return hn::Sqrt(hn::Mul(minor, hn::Max(hn::Zero(d), inside)));
}

/// The exact rows of an outline (AccuTile of Hanson et al. 2025): columns_in_band() for a
/// vector of tile rows at a time.
template <class D>
HWY_INLINE void add_exact_rows(D d, const ScreenSurfel& s, const ScreenEllipse<float>& outline,
                               const TileRange& range, DepthSlot entry, TileWriter& writer) {
  using Rows = hn::Vec<D>;
  const hn::RebindToSigned<D> di;
  constexpr auto kTile = static_cast<float>(kTileSizePx);
  const float slope = outline.sxy / outline.syy;
  const Rows half_height = hn::Set(d, std::sqrt(outline.syy));
  const Rows minor = hn::Set(d, std::max(0.0F, outline.sxx - outline.sxy * slope));
  const Rows inverse_syy = hn::Set(d, 1.0F / outline.syy);
  const float extreme = outline.sxx > 0.0F ? outline.sxy / std::sqrt(outline.sxx) : 0.0F;
  // k^2 / 2 = ln 2 c_k2.
  const Rows radius2 = hn::Set(d, 0.69314718F * s.c_k2 * kBoundSlack);
  const Rows lowest = hn::Set(d, static_cast<float>(range.x_begin));
  const Rows highest = hn::Set(d, static_cast<float>(range.x_end));
  const Rows centre_x = hn::Set(d, outline.cx_px);
  for (int row = range.y_begin; row < range.y_end; row += static_cast<int>(hn::Lanes(d))) {
    const Rows y_lo =
        hn::MulAdd(hn::Iota(d, static_cast<float>(row)), hn::Set(d, kTile), hn::Set(d, 0.5F));
    const Rows y_hi = hn::Add(y_lo, hn::Set(d, kTile - 1.0F));
    const Rows lo = hn::Max(hn::Sub(y_lo, hn::Set(d, outline.cy_px)), hn::Neg(half_height));
    const Rows hi = hn::Min(hn::Sub(y_hi, hn::Set(d, outline.cy_px)), half_height);
    const auto reached = hn::Le(lo, hi);
    const Rows y_right = hn::Min(hn::Max(hn::Set(d, extreme), lo), hi);
    const Rows y_left = hn::Min(hn::Max(hn::Set(d, -extreme), lo), hi);
    const Rows right = hn::Add(hn::MulAdd(hn::Set(d, slope), y_right, centre_x),
                               half_width_at(d, y_right, minor, inverse_syy));
    const Rows left = hn::Sub(hn::MulAdd(hn::Set(d, slope), y_left, centre_x),
                              half_width_at(d, y_left, minor, inverse_syy));
    Rows x_max = hn::IfThenElse(reached, right, hn::Set(d, -1e30F));
    Rows x_min = hn::IfThenElse(reached, left, hn::Set(d, 1e30F));
    if (s.shape != SurfelShape::kPlain) {  // Else the low pass lies within the outline.
      const Rows y0 = hn::Set(d, s.y0_px), x0 = hn::Set(d, s.x0_px);
      const Rows dy = hn::Max(hn::Max(hn::Sub(y_lo, y0), hn::Sub(y0, y_hi)), hn::Zero(d));
      const Rows h2 = hn::NegMulAdd(dy, dy, radius2);
      const Rows h = hn::Sqrt(hn::Max(h2, hn::Zero(d)));
      const auto meets = hn::Ge(h2, hn::Zero(d));
      x_min = hn::IfThenElse(meets, hn::Min(x_min, hn::Sub(x0, h)), x_min);
      x_max = hn::IfThenElse(meets, hn::Max(x_max, hn::Add(x0, h)), x_max);
    }
    // From the column whose last pixel centre reaches the span to that whose first one does.
    const Rows slack = hn::MulAdd(hn::Max(hn::Sub(x_max, x_min), hn::Zero(d)),
                                  hn::Set(d, 1e-4F), hn::Set(d, kSpanSlackPx + kTile - 0.5F));
    const Rows inverse_tile = hn::Set(d, 1.0F / kTile);
    const Rows first = hn::Ceil(hn::Mul(hn::Sub(x_min, slack), inverse_tile));
    const Rows last = hn::Floor(hn::Mul(hn::Add(x_max, slack), inverse_tile));
    alignas(64) std::int32_t begins[kMaxLanes], ends[kMaxLanes];
    hn::Store(hn::ConvertTo(di, hn::Min(hn::Max(first, lowest), highest)), di, begins);
    hn::Store(hn::ConvertTo(di, hn::Min(hn::Max(last, lowest), highest)), di, ends);
    const int rows = std::min(static_cast<int>(hn::Lanes(d)), range.y_end - row);
    for (int r = 0; r < rows; ++r) writer.add_row(row + r, begins[r], ends[r], entry);
  }
}

/// Enters the surfel in its tiles under the job's strategy.
void add_tiles(const ProjectionJob& job, std::size_t i, std::size_t slot,
               const ScreenEllipse<float>& exact, const ProjectedSurfels& out,
               TileWriter& writer) {
  const ScreenSurfel& s = out.screen[slot];
  const DepthSlot entry =
      DepthSlot{std::bit_cast<std::uint32_t>(s.z0_m)} << 32U | static_cast<DepthSlot>(slot);
  ScreenEllipse<float> outline = exact;
  const TileRange range =
      job.bounds == TileBounds::kAccuTile || job.bounds == TileBounds::kSnugBox
          ? exact_range(s)
          : approximate_range(job, i, outline);
  const bool exact_rows =
      job.bounds == TileBounds::kAccuTile || job.bounds == TileBounds::kPaper;
  // One tile wide or high: the box is the answer, unless the image's edge has cut it.
  const bool inside =
      s.x_lo > 0 && s.y_lo > 0 && s.x_hi < job.width_px - 1 && s.y_hi < job.height_px - 1;
  const bool narrow = range.y_end - range.y_begin < 2 || range.x_end - range.x_begin < 2;
  if (exact_rows && outline.syy > 0.0F && !(inside && narrow)) {
    // Most surfels reach few rows, and square roots of short vectors are cheaper.
    if (range.y_end - range.y_begin <= kFewRows) {
      add_exact_rows(hn::CappedTag<float, kFewRows>(), s, outline, range, entry, writer);
    } else {
      add_exact_rows(Floats(), s, outline, range, entry, writer);
    }
    return;
  }
  for (int y = range.y_begin; y < range.y_end; ++y) {
    writer.add_row(y, range.x_begin, range.x_end, entry);
  }
}

/// Projects visible cluster number v.
void project_cluster(const ProjectionJob& job, std::size_t v, ProjectedSurfels& out,
                     TileWriter& writer) {
  const std::size_t lane_count = hn::Lanes(Floats());
  const std::size_t first = out.visible[v].cluster * kClusterSize;
  const std::size_t first_slot = v * kClusterSize;
  std::size_t slot = first_slot;
  ProjectedLanes lanes;
  for (std::size_t i = first; i < first + kClusterSize; i += lane_count) {
    project_lanes(job, i, lanes);
    for (std::size_t lane = 0; lane < lane_count; ++lane) {
      if ((lanes.drawn >> lane & 1U) == 0) continue;
      ScreenEllipse<float> outline;
      if (!emit_surfel(job, lanes, lane, i + lane, slot, out, outline)) continue;
      add_tiles(job, i + lane, slot, outline, out, writer);
      ++slot;
    }
  }
  out.count[v] = static_cast<std::uint32_t>(slot - first_slot);
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer::internal
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace segsim::renderer::internal {
namespace {

HWY_EXPORT(project_cluster);

/// Image plane widened by the low pass: it reaches this far past a surfel's outline.
constexpr float kFrustumMarginPx = 3.0F;
/// Rounding of a centre's depth, relative to its distance.
constexpr float kDepthSlack = 1e-5F;

/// Tiles along one axis that a box of points can reach.
/// @param lateral_m  Middle of the box along the axis, camera frame.
/// @param z_m        The same along +z; `radius_m` less is in front of the camera.
/// @return  First tile and the one after the last.
std::pair<std::uint16_t, std::uint16_t> tiles_along(float lateral_m, float z_m, float radius_m,
                                                    float focal_px, float centre_px,
                                                    int size_px) {
  const float lo_m = lateral_m - radius_m, hi_m = lateral_m + radius_m;
  const float near_m = z_m - radius_m, far_m = z_m + radius_m;
  const float lo_px =
      centre_px + focal_px * lo_m / (lo_m < 0.0F ? near_m : far_m) - kFrustumMarginPx;
  const float hi_px =
      centre_px + focal_px * hi_m / (hi_m > 0.0F ? near_m : far_m) + kFrustumMarginPx;
  const auto last = static_cast<float>(size_px - 1);
  const auto tile = [last](float px) {
    return static_cast<int>(std::clamp(px, 0.0F, last)) / kTileSizePx;
  };
  return {static_cast<std::uint16_t>(tile(lo_px)),
          static_cast<std::uint16_t>(tile(hi_px) + 1)};
}

/// @param x_m, y_m, z_m  The cluster's centre in the camera's frame.
TileBox tiles_of_cluster(const ProjectionJob& job, float x_m, float y_m, float z_m,
                         float radius_m) {
  const auto tiles = [](int px) {
    return static_cast<std::uint16_t>((px + kTileSizePx - 1) / kTileSizePx);
  };
  if (z_m - radius_m <= job.near_m) return {0, tiles(job.width_px), 0, tiles(job.height_px)};
  const ProjectionCamera<float>& c = job.camera;
  const auto [x_begin, x_end] =
      tiles_along(x_m, z_m, radius_m, c.fx_px, c.cx_px, job.width_px);
  const auto [y_begin, y_end] =
      tiles_along(y_m, z_m, radius_m, c.fy_px, c.cy_px, job.height_px);
  return {x_begin, x_end, y_begin, y_end};
}

}  // namespace

void find_visible_clusters(const ProjectionJob& job, ProjectedSurfels& projected) {
  const ProjectionCamera<float>& c = job.camera;
  const float left = (-kFrustumMarginPx - c.cx_px) / c.fx_px;
  const float right =
      (static_cast<float>(job.width_px) + kFrustumMarginPx - c.cx_px) / c.fx_px;
  const float top = (-kFrustumMarginPx - c.cy_px) / c.fy_px;
  const float bottom =
      (static_cast<float>(job.height_px) + kFrustumMarginPx - c.cy_px) / c.fy_px;
  const float left_norm = std::hypot(1.0F, left), right_norm = std::hypot(1.0F, right);
  const float top_norm = std::hypot(1.0F, top), bottom_norm = std::hypot(1.0F, bottom);
  std::vector<VisibleCluster>& visible = projected.visible;
  visible.clear();
  visible.reserve(job.packed.cluster_count());
  for (std::size_t i = 0; i < job.packed.cluster_count(); ++i) {
    const Cluster& cluster = job.packed.clusters[i];
    const float r = cluster.radius_m;
    const Vec3<float> offset{cluster.centre_m.x - c.centre_m.x,
                             cluster.centre_m.y - c.centre_m.y,
                             cluster.centre_m.z - c.centre_m.z};
    const float z = dot(c.forward, offset);
    const float x = dot(c.right, offset);
    const float y = dot(c.down, offset);
    if (z + r < job.near_m) continue;
    if (x - z * left < -r * left_norm || x - z * right > r * right_norm) continue;
    if (y - z * top < -r * top_norm || y - z * bottom > r * bottom_norm) continue;
    const float nearest_m = z - cluster.centres_radius_m;
    visible.push_back({nearest_m - kDepthSlack * (1.0F + std::abs(x) + std::abs(y) + z),
                       static_cast<std::uint32_t>(i), tiles_of_cluster(job, x, y, z, r)});
  }
  std::sort(
      visible.begin(), visible.end(), [](const VisibleCluster& a, const VisibleCluster& b) {
        return a.nearest_m != b.nearest_m ? a.nearest_m < b.nearest_m : a.cluster < b.cluster;
      });
}

void ProjectedSurfels::reserve(std::size_t end) {
  // The arrays only grow, so that no frame allocates after the first ones.
  if (count.size() >= end) return;
  screen.resize(end * kClusterSize);
  shade.resize(end * kClusterSize);
  count.resize(end);
}

void project_clusters(const ProjectionJob& job, std::size_t begin, std::size_t end,
                      Workers& workers, ProjectedSurfels& projected, TileBins& bins) {
  projected.reserve(end);
  // Else the pointer would ask the processor about itself at every call.
  if (!hwy::GetChosenTarget().IsInitialized()) {
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  const auto project = HWY_DYNAMIC_DISPATCH(project_cluster);
  const std::size_t task_count = (end - begin + kClustersPerTask - 1) / kClustersPerTask;
  workers.for_each(task_count, [&](std::size_t task) {
    TileWriter& writer = bins.writer(workers.thread_index());
    const std::size_t first = begin + task * kClustersPerTask;
    for (std::size_t v = first; v < std::min(end, first + kClustersPerTask); ++v) {
      projected.count[v] = 0;
      if (writer.wants_any(projected.visible[v].tiles)) project(job, v, projected, writer);
    }
  });
}

}  // namespace segsim::renderer::internal
#endif  // HWY_ONCE
