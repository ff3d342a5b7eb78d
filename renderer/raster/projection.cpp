#include "renderer/raster/projection.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include <glm/geometric.hpp>

#include "renderer/raster/surfel_tiles.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/raster/projection.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "renderer/raster/exact_rows-inl.h"

#ifndef SEGSIM_RENDERER_PROJECTION_ONCE
#define SEGSIM_RENDERER_PROJECTION_ONCE
namespace segsim::renderer::internal {
namespace {

/// Rounding of the projected centre and outline stays below this [px].
constexpr float kPixelSlack = 1e-3F;
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
  alignas(64) float r[kMaxLanes], g[kMaxLanes], b[kMaxLanes];
  alignas(64) float nx[kMaxLanes], ny[kMaxLanes], nz[kMaxLanes];
  std::uint64_t drawn = 0, thin = 0, care = 0, clipped = 0;  ///< One bit a lane.
};

/// Coefficient k of packed surfel i; of degree 0 scenes its colour.
glm::vec3 coefficient_of(const std::vector<float>& planes, std::size_t i, std::size_t count,
                         std::size_t k) {
  const auto channel = [&](std::size_t c) {
    return planes[PackedSurfels::plane_index(i, count, k, c)];
  };
  return {channel(0), channel(1), channel(2)};
}

glm::vec3 colour_of(const ProjectionJob& job, std::size_t i) {
  const PackedSurfels& packed = job.packed;
  if (!packed.colour.empty()) return coefficient_of(packed.colour, i, 1, 0);
  const Vec3<float>& eye = job.camera.centre_m;
  const glm::vec3 direction = glm::normalize(
      glm::vec3(packed.x_m[i] - eye.x, packed.y_m[i] - eye.y, packed.z_m[i] - eye.z));
  float basis[16];
  sh_basis(job.cloud.sh_degree, Vec3<float>{direction.x, direction.y, direction.z}, basis);
  const std::size_t n = job.cloud.sh_count();
  glm::vec3 sum(0.5F);
  for (std::size_t k = 0; k < n; ++k) sum += basis[k] * coefficient_of(packed.sh, i, n, k);
  return glm::max(sum, glm::vec3(0.0F));
}

/// Harmonics of few degrees are summed up a vector of surfels at a time.
bool shades_lanes(const ProjectionJob& job) { return job.cloud.sh_degree <= 1; }

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
  if (shades_lanes(job)) {
    out.shade[slot] = {lanes.r[lane],       lanes.g[lane],       lanes.b[lane],
                       lanes.nx[lane],      lanes.ny[lane],      lanes.nz[lane],
                       job.packed.label[i], job.packed.surfel[i]};
  } else {
    out.shade[slot] = shade_of(job, i);
  }
  outline = {lanes.cx[lane], lanes.cy[lane], lanes.sxx[lane], lanes.sxy[lane],
             clipped ? -1.0F : lanes.syy[lane]};
  return true;
}

}  // namespace

SurfelShade shade_of(const ProjectionJob& job, std::size_t i) {
  const PackedSurfels& packed = job.packed;
  const Vec3<float>& eye = job.camera.centre_m;
  glm::vec3 normal(packed.nx[i], packed.ny[i], packed.nz[i]);
  const glm::vec3 ray(packed.x_m[i] - eye.x, packed.y_m[i] - eye.y, packed.z_m[i] - eye.z);
  if (glm::dot(normal, ray) > 0.0F) normal = -normal;
  const glm::vec3 colour = job.colours ? colour_of(job, i) : glm::vec3(0.0F);
  return {colour.r, colour.g, colour.b,        normal.x,
          normal.y, normal.z, packed.label[i], packed.surfel[i]};
}
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

/// shade_of(), to the bit, of harmonics up to degree 1. @param ray  From the camera's centre.
HWY_INLINE void shade_lanes(const ProjectionJob& job, std::size_t i, const V3& ray,
                            ProjectedLanes& out) {
  const Floats d;
  const PackedSurfels& p = job.packed;
  const auto dot3 = [](const V3& a, const V3& b) {
    return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
  };
  const V3 n = {hn::LoadU(d, &p.nx[i]), hn::LoadU(d, &p.ny[i]), hn::LoadU(d, &p.nz[i])};
  const V sign = hn::IfThenElseZero(hn::Gt(dot3(n, ray), hn::Zero(d)), hn::Set(d, -0.0F));
  hn::Store(hn::Xor(n.x, sign), d, out.nx);
  hn::Store(hn::Xor(n.y, sign), d, out.ny);
  hn::Store(hn::Xor(n.z, sign), d, out.nz);

  float* const channels[] = {out.r, out.g, out.b};
  if (!job.colours) {
    for (float* channel : channels) hn::Store(hn::Zero(d), d, channel);
    return;
  }
  if (!p.colour.empty()) {
    for (std::size_t c = 0; c < 3; ++c) {
      hn::Store(hn::LoadU(d, &p.colour[PackedSurfels::plane_index(i, 1, 0, c)]), d,
                channels[c]);
    }
    return;
  }
  const V inverse = hn::Div(hn::Set(d, 1.0F), hn::Sqrt(dot3(ray, ray)));
  const V plus = hn::Set(d, static_cast<float>(kShC1)), minus = hn::Neg(plus);
  const V basis[] = {hn::Set(d, kShC0), hn::Mul(minus, hn::Mul(ray.y, inverse)),
                     hn::Mul(plus, hn::Mul(ray.z, inverse)),
                     hn::Mul(minus, hn::Mul(ray.x, inverse))};
  for (std::size_t c = 0; c < 3; ++c) {
    V sum = hn::Set(d, 0.5F);
    for (std::size_t k = 0; k < 4; ++k) {
      const float* coefficient = &p.sh[PackedSurfels::plane_index(i, 4, k, c)];
      sum = hn::Add(sum, hn::Mul(basis[k], hn::LoadU(d, coefficient)));
    }
    hn::Store(hn::Max(sum, hn::Zero(d)), d, channels[c]);
  }
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
  if (shades_lanes(job)) shade_lanes(job, i, offset, out);
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
    // NOLINTNEXTLINE(bugprone-branch-clone): the vectors differ in length.
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

}  // namespace

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
