#include "worlds/surface/collision_mesh.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <numbers>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/error.h"
#include "sim/ground/ground_grid.h"
#include "worlds/surface/mesh_cleaning.h"
#include "worlds/surface/point_hygiene.h"
#include "worlds/surface/voxel_faces.h"

namespace segsim::worlds {
namespace {

/// A reconstruction that claims to be wider than this is broken, and would not fit in memory.
constexpr double kMaxExtent_m = 60.0;
/// Voids in the floor below this are filled when floor is all around.
constexpr double kMaxEnclosed_m2 = 2.0;

/// Points sorted by what they are evidence of.
struct SortedPoints {
  std::vector<glm::vec3> floor, obstacle;
};

SortedPoints sort_points(std::span<const glm::vec3> points_m,
                         std::span<const glm::vec3> normals,
                         const CollisionMeshOptions& options) {
  constexpr float kUpright = 0.7F;
  SortedPoints sorted;
  for (std::size_t k = 0; k < points_m.size(); ++k) {
    const glm::vec3& p = points_m[k];
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) continue;
    const bool upright = normals.empty() || std::abs(normals[k].z) > kUpright;
    if (std::abs(p.z) <= options.floor_band_m && upright) {
      sorted.floor.push_back(p);
    } else if (p.z > options.obstacle_min_m && p.z < options.ceiling_m) {
      sorted.obstacle.push_back(p);
    }
  }
  return sorted;
}

void measure_floor(const SortedPoints& points, CollisionMeshResult& result) {
  constexpr double kHeightLimit_m = 0.05;
  constexpr double kTiltLimit_rad = 2.0 / 180.0 * std::numbers::pi;
  std::vector<glm::vec3> low = points.floor;
  for (const glm::vec3& p : points.obstacle) {
    if (p.z < 0.3F) low.push_back(p);
  }
  const auto plane = find_floor(low, 0.3);
  if (!plane) {
    result.floor_height_m = result.floor_tilt_rad = std::numeric_limits<double>::quiet_NaN();
    result.warnings.emplace_back("no level plane stands out near z = 0");
    return;
  }
  result.floor_height_m = plane->height_m;
  result.floor_tilt_rad = plane->tilt_rad;
  if (std::abs(plane->height_m) > kHeightLimit_m) {
    result.warnings.push_back("the floor lies at z = " + std::to_string(plane->height_m) +
                              " m, not 0");
  }
  if (plane->tilt_rad > kTiltLimit_rad) {
    result.warnings.push_back("the floor is tilted by " +
                              std::to_string(plane->tilt_rad / std::numbers::pi * 180.0) +
                              " deg");
  }
}

[[noreturn]] void refuse_without_floor(double seen_m2) {
  char found[96];
  std::snprintf(found, sizeof found, "no level plane, and %.2f m2 of level places", seen_m2);
  throw core::InputError::expected("reconstruction", "a floor near z = 0", found);
}

/// Cameras alone make no floor: in a recording whose heights mean nothing it would lie
/// anywhere.
void require_floor(const CollisionMeshResult& result, const CollisionMeshOptions& options) {
  const bool stands_out = !std::isnan(result.floor_height_m);
  if (stands_out || options.floor_is_known) return;
  if (result.floor_seen_m2 < options.least_floor_m2)
    refuse_without_floor(result.floor_seen_m2);
}

VoxelBox empty_box(const SortedPoints& points, std::span<const glm::dvec3> cameras_m,
                   const CollisionMeshOptions& options) {
  glm::dvec2 lo(std::numeric_limits<double>::infinity());
  glm::dvec2 hi = -lo;
  const auto extend = [&](const glm::dvec2& p) {
    lo = glm::min(lo, p);
    hi = glm::max(hi, p);
  };
  for (const auto* group : {&points.floor, &points.obstacle}) {
    for (const glm::vec3& p : *group) extend({p.x, p.y});
  }
  for (const glm::dvec3& p : cameras_m) extend({p.x, p.y});
  const glm::dvec2 extent = hi - lo;
  if (!(std::max(extent.x, extent.y) < kMaxExtent_m)) {
    throw core::InputError::expected("reconstruction", "points within 60 m", "a wider spread");
  }
  // Room for closing to work up to the edge.
  const double margin_m =
      std::max(options.close_floor_m, options.walked_radius_m) + 2.0 * options.voxel_m;
  VoxelBox box;
  box.cell_m = options.voxel_m;
  box.origin_m = glm::dvec3(glm::floor((lo - margin_m) / box.cell_m) * box.cell_m, 0.0);
  box.size = glm::ivec3(glm::ivec2(glm::ceil((extent + 2.0 * margin_m) / box.cell_m)) + 1,
                        static_cast<int>(std::ceil(options.ceiling_m / box.cell_m)));
  box.occupied.assign(static_cast<std::size_t>(box.size.x) *
                          static_cast<std::size_t>(box.size.y) *
                          static_cast<std::size_t>(box.size.z),
                      0);
  return box;
}

glm::ivec3 voxel_of(const VoxelBox& box, const glm::vec3& p_m) {
  return glm::ivec3(glm::floor((glm::dvec3(p_m) - box.origin_m) / box.cell_m));
}

/// Removes 26-connected groups of voxels that hold fewer than `min_points` points.
/// @return  Points removed.
std::size_t remove_floaters(VoxelBox& box, const std::vector<std::uint16_t>& counts,
                            int min_points) {
  std::vector<std::uint8_t> visited(box.occupied.size(), 0);
  std::size_t removed = 0;
  std::vector<glm::ivec3> group;
  for (int z = 0; z < box.size.z; ++z) {
    for (int y = 0; y < box.size.y; ++y) {
      for (int x = 0; x < box.size.x; ++x) {
        const glm::ivec3 first(x, y, z);
        if (!box.at(first) || visited[box.index(first)] != 0) continue;
        group.assign(1, first);
        visited[box.index(first)] = 1;
        std::size_t points = 0;
        for (std::size_t head = 0; head < group.size(); ++head) {
          const glm::ivec3 here = group[head];
          points += counts[box.index(here)];
          for (int n = 0; n < 27; ++n) {
            const glm::ivec3 next = here + glm::ivec3(n % 3, n / 3 % 3, n / 9) - 1;
            if (!box.at(next) || visited[box.index(next)] != 0) continue;
            visited[box.index(next)] = 1;
            group.push_back(next);
          }
        }
        if (points >= static_cast<std::size_t>(min_points)) continue;
        removed += points;
        for (const glm::ivec3& v : group) box.occupied[box.index(v)] = 0;
      }
    }
  }
  return removed;
}

/// The halves of occupied voxels that hold points themselves.
VoxelBox refined(const VoxelBox& box, std::span<const glm::vec3> points_m,
                 const std::vector<std::size_t>& kept) {
  VoxelBox fine;
  fine.origin_m = box.origin_m;
  fine.cell_m = 0.5 * box.cell_m;
  fine.size = 2 * box.size;
  fine.occupied.assign(8 * box.occupied.size(), 0);
  for (const std::size_t k : kept) {
    // Via the fine voxel, so that rounding cannot put a point into two places.
    const glm::ivec3 v = voxel_of(fine, points_m[k]);
    if (!box.at(v / 2)) continue;
    // Tightness matters in plan only; whole voxels in height merge into fewer faces.
    fine.occupied[fine.index({v.x, v.y, v.z / 2 * 2})] = 1;
    fine.occupied[fine.index({v.x, v.y, v.z / 2 * 2 + 1})] = 1;
  }
  return fine;
}

/// Fills `box` with the voxels that count as obstacles. @return  The same, refined.
VoxelBox occupy_voxels(std::span<const glm::vec3> points_m,
                       const CollisionMeshOptions& options, VoxelBox& box,
                       CollisionMeshResult& result) {
  const std::vector<std::size_t> kept =
      without_outliers(points_m, options.outlier_neighbors, options.outlier_deviations);
  result.outliers = points_m.size() - kept.size();
  std::vector<std::uint16_t> counts(box.occupied.size(), 0);
  std::vector<std::uint32_t> column(
      static_cast<std::size_t>(box.size.x) * static_cast<std::size_t>(box.size.y), 0);
  for (const std::size_t k : kept) {
    const std::size_t index = box.index(voxel_of(box, points_m[k]));
    if (counts[index] < std::numeric_limits<std::uint16_t>::max()) ++counts[index];
    ++column[index % column.size()];
  }
  for (std::size_t k = 0; k < counts.size(); ++k) {
    box.occupied[k] =
        counts[k] >= options.min_points_per_voxel &&
        column[k % column.size()] >= static_cast<std::uint32_t>(options.min_points_per_column);
  }
  result.floaters = remove_floaters(box, counts, options.min_cluster_points);
  result.obstacle_voxels = static_cast<std::size_t>(
      std::count(box.occupied.begin(), box.occupied.end(), std::uint8_t{1}));
  return refined(box, points_m, kept);
}

double area_m2(const sim::GridMask& mask, double cell_m) {
  return cell_m * cell_m *
         static_cast<double>(std::count(mask.pixels().begin(), mask.pixels().end(), 1));
}

/// Dilation, then erosion, by a disc.
sim::GridMask closed(const sim::GridMask& mask, double radius_m, double cell_m) {
  const core::Image<float> to_marked = sim::distance_to_marked(mask, cell_m);
  sim::GridMask rest(mask.width_px(), mask.height_px(), 0);
  for (std::size_t k = 0; k < rest.size(); ++k) {
    rest.pixels()[k] = static_cast<double>(to_marked.pixels()[k]) > radius_m ? 1 : 0;
  }
  const core::Image<float> to_rest = sim::distance_to_marked(rest, cell_m);
  sim::GridMask result = mask;
  for (std::size_t k = 0; k < result.size(); ++k) {
    if (static_cast<double>(to_rest.pixels()[k]) > radius_m) result.pixels()[k] = 1;
  }
  return result;
}

void fill_enclosed(sim::GridMask& mask, double cell_m) {
  sim::GridMask rest = mask;
  for (std::uint8_t& value : rest.pixels()) value = value == 0 ? 1 : 0;
  const core::Image<std::int32_t> piece = sim::label_pieces(rest);
  std::vector<std::size_t> size(1, 0);
  std::vector<bool> open(1, true);
  for (int j = 0; j < mask.height_px(); ++j) {
    for (int i = 0; i < mask.width_px(); ++i) {
      const auto id = static_cast<std::size_t>(piece(i, j));
      if (id >= size.size()) {
        size.resize(id + 1, 0);
        open.resize(id + 1, false);
      }
      ++size[id];
      if (i == 0 || j == 0 || i + 1 == mask.width_px() || j + 1 == mask.height_px()) {
        open[id] = true;
      }
    }
  }
  for (std::size_t k = 0; k < mask.size(); ++k) {
    const auto id = static_cast<std::size_t>(piece.pixels()[k]);
    if (id > 0 && !open[id] &&
        static_cast<double>(size[id]) * cell_m * cell_m < kMaxEnclosed_m2) {
      mask.pixels()[k] = 1;
    }
  }
}

sim::GridMask floor_columns(const SortedPoints& points, std::span<const glm::dvec3> cameras_m,
                            const VoxelBox& box, const CollisionMeshOptions& options,
                            CollisionMeshResult& result) {
  sim::GridMask floor(box.size.x, box.size.y, 0);
  for (const glm::vec3& p : points.floor) {
    const glm::ivec3 v = voxel_of(box, p);
    floor(v.x, v.y) = 1;
  }
  result.floor_seen_m2 = area_m2(floor, box.cell_m);
  require_floor(result, options);
  for (int z = 0; z < box.size.z; ++z) {
    for (int y = 0; y < box.size.y; ++y) {
      for (int x = 0; x < box.size.x; ++x) {
        if (box.at({x, y, z})) floor(x, y) = 1;
      }
    }
  }
  const int span = static_cast<int>(std::ceil(options.walked_radius_m / box.cell_m));
  for (const glm::dvec3& camera : cameras_m) {
    const glm::ivec3 v = voxel_of(box, glm::vec3(camera));
    for (int y = v.y - span; y <= v.y + span; ++y) {
      for (int x = v.x - span; x <= v.x + span; ++x) {
        const double d_m = box.cell_m * std::hypot(x - v.x, y - v.y);
        if (floor.contains(x, y) && d_m <= options.walked_radius_m) floor(x, y) = 1;
      }
    }
  }
  floor = closed(floor, 0.5 * options.close_floor_m, box.cell_m);
  fill_enclosed(floor, box.cell_m);
  result.floor_m2 = area_m2(floor, box.cell_m);
  return floor;
}

/// The triangles that a robot can meet.
void append_obstacle_triangles(const sim::TriangleMesh& surface,
                               const CollisionMeshOptions& options, sim::TriangleMesh& mesh) {
  constexpr float kUpright = 0.7F;
  constexpr std::uint32_t kNew = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> place(surface.positions_m.size(), kNew);
  for (const glm::uvec3& t : surface.triangles) {
    const auto z = [&](int i) { return static_cast<double>(surface.positions_m[t[i]].z); };
    const double lowest = std::min({z(0), z(1), z(2)}), highest = std::max({z(0), z(1), z(2)});
    const bool is_floor = highest <= options.obstacle_min_m &&
                          std::abs(triangle_normal(surface, t).z) > kUpright;
    if (is_floor || highest <= 0.0 || lowest >= options.ceiling_m) continue;
    glm::uvec3 moved(0U);
    for (int i = 0; i < 3; ++i) {
      std::uint32_t& to = place[t[i]];
      if (to == kNew) {
        to = static_cast<std::uint32_t>(mesh.positions_m.size());
        mesh.positions_m.push_back(surface.positions_m[t[i]]);
      }
      moved[i] = to;
    }
    mesh.triangles.push_back(moved);
  }
}

void append_floor_cells(sim::GridMask floor, const VoxelBox& box, sim::TriangleMesh& mesh) {
  for (const CellRectangle& r : merge_cells(floor)) {
    const auto x = [&](int i) { return static_cast<float>(box.origin_m.x + box.cell_m * i); };
    const auto y = [&](int j) { return static_cast<float>(box.origin_m.y + box.cell_m * j); };
    sim::append_floor(mesh, x(r.i0), y(r.j0), x(r.i1), y(r.j1));
  }
}

}  // namespace

std::vector<std::pair<std::string, double>> CollisionMeshResult::statistics() const {
  return {{"collision_points", static_cast<double>(points)},
          {"collision_outliers", static_cast<double>(outliers)},
          {"collision_floaters", static_cast<double>(floaters)},
          {"collision_voxels", static_cast<double>(obstacle_voxels)},
          {"collision_triangles", static_cast<double>(mesh.triangles.size())},
          {"floor_height_m", floor_height_m},
          {"floor_tilt_rad", floor_tilt_rad},
          {"floor_seen_m2", floor_seen_m2},
          {"floor_m2", floor_m2}};
}

CollisionMeshResult make_collision_mesh(std::span<const glm::vec3> points_m,
                                        std::span<const glm::vec3> normals,
                                        std::span<const glm::dvec3> camera_positions_m,
                                        const CollisionMeshOptions& options) {
  SEGSIM_CHECK(normals.empty() || normals.size() == points_m.size(), "one normal per point");
  SEGSIM_CHECK(options.voxel_m > 0.0 && options.ceiling_m > options.obstacle_min_m, "options");
  CollisionMeshResult result;
  result.points = points_m.size();
  const SortedPoints points = sort_points(points_m, normals, options);
  if (points.floor.empty() && camera_positions_m.empty()) refuse_without_floor(0.0);
  measure_floor(points, result);

  VoxelBox box = empty_box(points, camera_positions_m, options);
  append_exposed_faces(occupy_voxels(points.obstacle, options, box, result), result.mesh);
  append_floor_cells(floor_columns(points, camera_positions_m, box, options, result), box,
                     result.mesh);
  return result;
}

CollisionMeshResult collision_mesh_of_surface(const sim::TriangleMesh& surface,
                                              std::span<const glm::dvec3> camera_positions_m,
                                              const CollisionMeshOptions& options) {
  SEGSIM_CHECK(options.voxel_m > 0.0 && options.ceiling_m > options.obstacle_min_m, "options");
  CollisionMeshResult result;
  const SurfaceSamples samples = sample_surface(surface, 0.5 * options.voxel_m);
  result.points = samples.points_m.size();
  const SortedPoints points = sort_points(samples.points_m, samples.normals, options);
  if (points.floor.empty() && camera_positions_m.empty()) refuse_without_floor(0.0);
  measure_floor(points, result);
  VoxelBox box = empty_box(points, camera_positions_m, options);
  for (const glm::vec3& p : points.obstacle) box.occupied[box.index(voxel_of(box, p))] = 1;
  result.obstacle_voxels = static_cast<std::size_t>(
      std::count(box.occupied.begin(), box.occupied.end(), std::uint8_t{1}));
  append_obstacle_triangles(surface, options, result.mesh);
  append_floor_cells(floor_columns(points, camera_positions_m, box, options, result), box,
                     result.mesh);
  return result;
}

}  // namespace segsim::worlds
