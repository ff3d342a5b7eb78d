#include "renderer/internal/reference_surfels.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "renderer/scene/projection_camera.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::internal {
namespace {

Vec3<double> vec(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

/// Of the surfel's numbers in the camera frame, so that the camera is the unit one.
SurfelProjection<double> local_form(const ReferenceSurfel& s,
                                    const core::CameraIntrinsics& c) {
  const ProjectionCamera<double> camera{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0},
                                        {0.0, 0.0, 0.0}, c.fx_px,         c.fy_px,
                                        c.cx_px,         c.cy_px};
  return project_surfel<double>(camera, vec(s.centre_m), vec(s.u_m), vec(s.v_m));
}

/// Product of rows i and j with the metric diag(k^2, k^2, -1): entry (i, j) of the dual conic
/// of the image of |u| = k.
double dual_conic(const glm::dmat3& H, int i, int j, double k2) {
  return k2 * (H[0][i] * H[0][j] + H[1][i] * H[1][j]) - H[2][i] * H[2][j];
}

/// As box_of_dual_conic(), from the conic's matrix.
ConicBox<double> conic_box(const glm::dmat3& H, double k2) {
  const double d = dual_conic(H, 2, 2, k2);
  const double x = dual_conic(H, 0, 2, k2) / d, y = dual_conic(H, 1, 2, k2) / d;
  const double half_width2 = x * x - dual_conic(H, 0, 0, k2) / d;
  const double half_height2 = y * y - dual_conic(H, 1, 1, k2) / d;
  return {x, y, std::sqrt(std::max(half_width2, 1e-4)),
          std::sqrt(std::max(half_height2, 1e-4)), d != 0.0};
}

}  // namespace

ReferenceSurfels::ReferenceSurfels(const SurfelCloud& cloud, const RenderOptions& options,
                                   const core::CameraPose& T_world_camera,
                                   const core::CameraIntrinsics& intrinsics)
    : cloud_(cloud),
      options_(options),
      T_world_camera_(T_world_camera),
      intrinsics_(intrinsics),
      tiles_x_((intrinsics.width_px + kCompatTilePx - 1) / kCompatTilePx),
      tiles_y_((intrinsics.height_px + kCompatTilePx - 1) / kCompatTilePx) {
  const bool exact = options.compat == Compat::kExact;
  const float near_m = exact ? options.near_m : rules_of(options.compat).near_m;
  const float far_m = exact ? INFINITY : rules_of(options.compat).far_m;
  const auto key_camera = projection_camera<float>(T_world_camera, intrinsics);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const glm::vec3& p = cloud.position_m[i];
    const float key = depth_of_centre<float>(key_camera, {p.x, p.y, p.z});
    if (!(key > near_m && key < far_m) || extent_squared(cloud.opacity[i]) <= 0.0F) continue;
    ReferenceSurfel s = in_camera(i);
    s.depth_key = key;
    if (exact) {
      apply_exact(s);
    } else if (!apply_compat(s)) {
      continue;
    }
    sorted_.push_back(s);
  }
  std::stable_sort(sorted_.begin(), sorted_.end(),
                   [](const ReferenceSurfel& a, const ReferenceSurfel& b) {
                     return a.depth_key < b.depth_key;
                   });
}

glm::dvec3 ReferenceSurfels::colour_of(std::size_t i, const glm::dvec3& eye_m) const {
  const glm::dvec3 direction = glm::normalize(glm::dvec3(cloud_.position_m[i]) - eye_m);
  double basis[16];
  sh_basis(cloud_.sh_degree, vec(direction), basis);
  glm::dvec3 sum(0.5);
  for (std::size_t k = 0; k < cloud_.sh_count(); ++k) {
    sum += basis[k] * glm::dvec3(cloud_.sh[i * cloud_.sh_count() + k]);
  }
  return glm::max(sum, glm::dvec3(0.0));
}

ReferenceSurfel ReferenceSurfels::in_camera(std::size_t i) const {
  const auto T_camera_world = T_world_camera_.inverse();
  const glm::dvec3 p_world(cloud_.position_m[i]);
  const glm::dmat3 R = glm::mat3_cast(glm::dquat(cloud_.R_world_surfel[i]));
  const glm::dvec2 scale(cloud_.scale_m[i]);
  const glm::dvec3 eye_m = T_world_camera_.translation_m();
  ReferenceSurfel s{};
  s.index = i;
  s.centre_m = (T_camera_world * core::Point<core::frame::World>{p_world}).xyz_m;
  s.u_m = T_camera_world.rotation() * (R[0] * scale.x);
  s.v_m = T_camera_world.rotation() * (R[1] * scale.y);
  s.normal_world = glm::normalize(R[2]);
  if (glm::dot(s.normal_world, p_world - eye_m) > 0.0) s.normal_world = -s.normal_world;
  s.colour = colour_of(i, eye_m);
  s.opacity = cloud_.opacity[i];
  s.k2 = extent_squared(s.opacity);
  return s;
}

void ReferenceSurfels::apply_exact(ReferenceSurfel& s) const {
  s.low_pass_px = intrinsics_.project(s.centre_m);
  const double reach_m = std::sqrt(s.k2 * (s.u_m.z * s.u_m.z + s.v_m.z * s.v_m.z));
  s.z_min_m = std::max(s.centre_m.z - reach_m, static_cast<double>(options_.near_m));
  s.z_max_m = s.centre_m.z + reach_m;
  const SurfelProjection<double> local = local_form(s, intrinsics_);
  s.edge_on = local.edge_on;
  if (options_.bounds == TileBounds::kAabb) {
    s.tiles = tiles_of_square(aabb_3_sigma(local), tiles_x_, tiles_y_);
  } else if (options_.bounds == TileBounds::kPaper) {
    s.rows = paper_outline(local, s.k2);
  }
}

bool ReferenceSurfels::apply_compat(ReferenceSurfel& s) const {
  const CompatRules rules = rules_of(options_.compat);
  if (rules.cull_edge_on && glm::dot(glm::cross(s.u_m, s.v_m), s.centre_m) == 0.0) {
    return false;
  }
  const ConicBox<double> box = conic_box(homography(s), rules.box_k2);
  s.low_pass_px = {box.cx_px, box.cy_px};
  s.tiles = compat_tiles(options_.compat, box, tiles_x_, tiles_y_);
  return !s.tiles.empty();
}

glm::dmat3 ReferenceSurfels::homography(const ReferenceSurfel& s) const {
  const auto column = [&](const glm::dvec3& p) {
    return glm::dvec3(intrinsics_.fx_px * p.x + intrinsics_.cx_px * p.z,
                      intrinsics_.fy_px * p.y + intrinsics_.cy_px * p.z, p.z);
  };
  return {column(s.u_m), column(s.v_m), column(s.centre_m)};
}

bool ReferenceSurfels::lists_may_miss() const {
  return options_.compat != Compat::kExact || options_.bounds == TileBounds::kAabb ||
         options_.bounds == TileBounds::kPaper;
}

bool ReferenceSurfels::listed(const ReferenceSurfel& s, int tile_x, int tile_y) const {
  if (!lists_may_miss()) return true;
  if (options_.compat != Compat::kExact || options_.bounds == TileBounds::kAabb) {
    return s.tiles.contains(tile_x, tile_y);
  }
  // Rows and columns of the tile's first and last pixel centres.
  const double x_lo = tile_x * kCompatTilePx + 0.5, x_hi = x_lo + kCompatTilePx - 1;
  const double y_lo = tile_y * kCompatTilePx + 0.5, y_hi = y_lo + kCompatTilePx - 1;
  const ColumnSpan<double> span =
      columns_in_band(s.rows, s.low_pass_px.x, s.low_pass_px.y, 0.5 * s.k2, y_lo, y_hi);
  return span.x_min_px <= x_hi && span.x_max_px >= x_lo;
}

Meeting ReferenceSurfels::meet(const ReferenceSurfel& s, const glm::dvec2& px) const {
  return options_.compat == Compat::kExact ? meet_exact(s, px) : meet_compat(s, px);
}

Meeting ReferenceSurfels::meet_exact(const ReferenceSurfel& s, const glm::dvec2& px) const {
  const glm::dvec2 offset = px - s.low_pass_px;
  const double rho_low_pass = 2.0 * glm::dot(offset, offset);
  double rho_disc = std::numeric_limits<double>::infinity();
  double depth_m = s.centre_m.z;
  if (!s.edge_on) {
    const glm::dvec3 ray = intrinsics_.back_project(px, 1.0);
    const glm::dvec3 normal = glm::cross(s.u_m, s.v_m);
    const double along = glm::dot(normal, ray);
    depth_m = glm::dot(normal, s.centre_m) / along;
    if (depth_m >= options_.near_m && std::isfinite(depth_m)) {
      const glm::dvec3 on_disc = ray * depth_m - s.centre_m;
      const double u = glm::dot(on_disc, s.u_m) / glm::dot(s.u_m, s.u_m);
      const double v = glm::dot(on_disc, s.v_m) / glm::dot(s.v_m, s.v_m);
      rho_disc = u * u + v * v;
    } else if (!(depth_m > 0.0)) {
      depth_m = s.z_max_m;  // The plane recedes beyond the horizon.
    }
  }
  const double rho = std::min(rho_disc, rho_low_pass);
  if (rho > s.k2) return {};
  const double alpha =
      std::min(static_cast<double>(kMaxAlpha), s.opacity * std::exp(-0.5 * rho));
  return {alpha, std::clamp(depth_m, s.z_min_m, s.z_max_m)};
}

Meeting ReferenceSurfels::meet_compat(const ReferenceSurfel& s, const glm::dvec2& px) const {
  const CompatRules rules = rules_of(options_.compat);
  const glm::dmat3 H = homography(s);
  const glm::dvec3 row_x(H[0][0], H[1][0], H[2][0]), row_y(H[0][1], H[1][1], H[2][1]);
  const glm::dvec3 row_z(H[0][2], H[1][2], H[2][2]);
  // The ray is where the planes of its column and its row meet, in (u, v, 1).
  const glm::dvec3 p = glm::cross(px.x * row_z - row_x, px.y * row_z - row_y);
  if (p.z == 0.0) return {};
  const glm::dvec3 on_disc(p.x / p.z, p.y / p.z, 1.0);
  const double rho_disc = on_disc.x * on_disc.x + on_disc.y * on_disc.y;
  const double plane_depth_m = glm::dot(row_z, on_disc);
  if (rules.fragments_near && plane_depth_m < static_cast<double>(rules.near_m)) return {};
  const glm::dvec2 offset = px - s.low_pass_px;
  const double rho = std::min(rho_disc, 2.0 * glm::dot(offset, offset));
  if (rho > s.k2) return {};
  const double alpha =
      std::min(static_cast<double>(kMaxAlpha), s.opacity * std::exp(-0.5 * rho));
  return {alpha, rules.centre_depth ? s.centre_m.z : plane_depth_m};
}

}  // namespace segsim::renderer::internal
