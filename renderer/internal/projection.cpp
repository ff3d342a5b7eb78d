#include "renderer/internal/projection.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <glm/geometric.hpp>

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
  std::uint64_t drawn = 0, needs_care = 0, clipped = 0;  ///< One bit a lane.
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

/// Appends lane `lane` (packed surfel i) at `slot`; false if it covers no pixel.
bool emit_surfel(const ProjectionJob& job, const ProjectedLanes& lanes, std::size_t lane,
                 std::size_t i, std::size_t slot, ProjectedSurfels& out) {
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
            job.packed.log2_opacity[i],
            job.packed.k2[i],
            lanes.e_min[lane],
            lanes.e_max[lane],
            static_cast<std::uint16_t>(range.x_min_px),
            static_cast<std::uint16_t>(range.x_max_px),
            static_cast<std::uint16_t>(range.y_min_px),
            static_cast<std::uint16_t>(range.y_max_px),
            static_cast<std::uint32_t>(lanes.needs_care >> lane & 1U)};
  out.shade[slot] = shade_of(job, i);
  out.outline[slot] = {lanes.cx[lane], lanes.cy[lane], lanes.sxx[lane], lanes.sxy[lane],
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
  out.needs_care = bits_of(hn::Or(hn::Or(thin, clipped), edge_on));
  out.clipped = bits_of(clipped);
  const V e_min = hn::Div(hn::Set(d, 1.0F / kBoundSlack), kw1);
  const V e_max = hn::Div(hn::Set(d, kBoundSlack), hn::Max(hn::Sub(one, kw), nu));

  hn::Store(x0, d, out.x0), hn::Store(y0, d, out.y0), hn::Store(z0, d, out.z0);
  hn::Store(m00, d, out.m00), hn::Store(m01, d, out.m01);
  hn::Store(m10, d, out.m10), hn::Store(m11, d, out.m11);
  hn::Store(g0, d, out.g0), hn::Store(g1, d, out.g1);
  hn::Store(e_min, d, out.e_min), hn::Store(e_max, d, out.e_max);
  hn::Store(cx, d, out.cx), hn::Store(cy, d, out.cy);
  hn::Store(sxx, d, out.sxx), hn::Store(sxy, d, out.sxy), hn::Store(syy, d, out.syy);
  hn::Store(x_lo, d, out.x_lo), hn::Store(x_hi, d, out.x_hi);
  hn::Store(y_lo, d, out.y_lo), hn::Store(y_hi, d, out.y_hi);
}

/// Projects visible cluster number v.
void project_cluster(const ProjectionJob& job, std::size_t v, ProjectedSurfels& out) {
  const std::size_t lane_count = hn::Lanes(Floats());
  const std::size_t first = out.visible_clusters[v] * kClusterSize;
  const std::size_t first_slot = v * kClusterSize;
  std::size_t slot = first_slot;
  ProjectedLanes lanes;
  for (std::size_t i = first; i < first + kClusterSize; i += lane_count) {
    project_lanes(job, i, lanes);
    for (std::size_t lane = 0; lane < lane_count; ++lane) {
      if ((lanes.drawn >> lane & 1U) == 0) continue;
      if (emit_surfel(job, lanes, lane, i + lane, slot, out)) ++slot;
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

void find_visible_clusters(const ProjectionJob& job, std::vector<std::uint32_t>& visible) {
  const ProjectionCamera<float>& c = job.camera;
  const float left = (-kFrustumMarginPx - c.cx_px) / c.fx_px;
  const float right =
      (static_cast<float>(job.width_px) + kFrustumMarginPx - c.cx_px) / c.fx_px;
  const float top = (-kFrustumMarginPx - c.cy_px) / c.fy_px;
  const float bottom =
      (static_cast<float>(job.height_px) + kFrustumMarginPx - c.cy_px) / c.fy_px;
  const float left_norm = std::hypot(1.0F, left), right_norm = std::hypot(1.0F, right);
  const float top_norm = std::hypot(1.0F, top), bottom_norm = std::hypot(1.0F, bottom);
  visible.clear();
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
    visible.push_back(static_cast<std::uint32_t>(i));
  }
}

}  // namespace

void project_surfels(const ProjectionJob& job, Workers& workers, ProjectedSurfels& projected) {
  // Room for the whole scene once, so that no frame allocates after the first.
  if (projected.count.size() < job.packed.cluster_count()) {
    const std::size_t slots = job.packed.cluster_count() * kClusterSize;
    projected.visible_clusters.reserve(job.packed.cluster_count());
    projected.count.resize(job.packed.cluster_count());
    projected.screen.resize(slots);
    projected.shade.resize(slots);
    projected.outline.resize(slots);
  }
  find_visible_clusters(job, projected.visible_clusters);
  constexpr std::size_t kClustersPerTask = 32;
  const std::size_t total = projected.visible_clusters.size();
  const auto project = HWY_DYNAMIC_DISPATCH(project_cluster);
  workers.for_each((total + kClustersPerTask - 1) / kClustersPerTask, [&](std::size_t task) {
    const std::size_t end = std::min(total, (task + 1) * kClustersPerTask);
    for (std::size_t v = task * kClustersPerTask; v < end; ++v) project(job, v, projected);
  });
}

}  // namespace segsim::renderer::internal
#endif  // HWY_ONCE
