#include "sim/ground/ground_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "sim/ground/ground_limit.h"

namespace segsim::sim {
namespace {

/// A triangle cut by two planes has at most five corners.
struct Polygon {
  std::array<glm::dvec3, 8> corners{};
  int count = 0;
  void add(const glm::dvec3& p) { corners[static_cast<std::size_t>(count++)] = p; }
  [[nodiscard]] const glm::dvec3& operator[](int i) const {
    return corners[static_cast<std::size_t>(i)];
  }
};

/// Sutherland-Hodgman against one horizontal plane; keeps sign * (z - z_plane) >= 0.
Polygon clip_z(const Polygon& in, double z_plane_m, double sign) {
  Polygon out;
  for (int i = 0; i < in.count; ++i) {
    const glm::dvec3& a = in[i];
    const glm::dvec3& b = in[(i + 1) % in.count];
    const double da = sign * (a.z - z_plane_m);
    const double db = sign * (b.z - z_plane_m);
    if (da >= 0.0) out.add(a);
    if ((da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0))
      out.add(a + (b - a) * (da / (da - db)));
  }
  return out;
}

Polygon triangle_of(const TriangleMesh& mesh, const glm::uvec3& t) {
  Polygon polygon;
  for (int corner = 0; corner < 3; ++corner) {
    polygon.add(glm::dvec3(mesh.positions_m[t[corner]]));
  }
  return polygon;
}

/// Whether the normal (nx, ny) separates the polygon, in plan, from the square [lo, hi].
bool separates(const Polygon& polygon, double nx, double ny, const glm::dvec2& lo,
               const glm::dvec2& hi) {
  double min_p = std::numeric_limits<double>::infinity();
  double max_p = -min_p;
  for (int i = 0; i < polygon.count; ++i) {
    const double s = nx * polygon[i].x + ny * polygon[i].y;
    min_p = std::min(min_p, s);
    max_p = std::max(max_p, s);
  }
  const double min_q = nx * (nx > 0 ? lo.x : hi.x) + ny * (ny > 0 ? lo.y : hi.y);
  const double max_q = nx * (nx > 0 ? hi.x : lo.x) + ny * (ny > 0 ? hi.y : lo.y);
  return max_p < min_q || max_q < min_p;
}

/// Separating axes of two convex shapes, one of them possibly a segment: all edge normals. The
/// axes of the square are handled by the loop over cells.
bool overlaps(const Polygon& polygon, const glm::dvec2& lo, const glm::dvec2& hi) {
  for (int i = 0; i < polygon.count; ++i) {
    const glm::dvec3 edge = polygon[(i + 1) % polygon.count] - polygon[i];
    if (separates(polygon, -edge.y, edge.x, lo, hi)) return false;
  }
  return true;
}

struct CellRange {
  int i0, j0, i1, j1;  ///< Inclusive.
};

/// Cells are shifted by a hair, so that a wall on a grid line falls into one cell in spite of
/// rounding.
constexpr double kNudge = 1e-3;

CellRange cells_around(const Polygon& polygon, const GridFrame& frame) {
  glm::dvec2 lo(std::numeric_limits<double>::infinity());
  glm::dvec2 hi = -lo;
  for (int i = 0; i < polygon.count; ++i) {
    lo = glm::min(lo, glm::dvec2(polygon[i]));
    hi = glm::max(hi, glm::dvec2(polygon[i]));
  }
  lo = (lo - frame.origin_m) / frame.cell_m + kNudge;
  hi = (hi - frame.origin_m) / frame.cell_m + kNudge;
  return {std::max(0, static_cast<int>(std::floor(lo.x))),
          std::max(0, static_cast<int>(std::floor(lo.y))),
          std::min(frame.width - 1, static_cast<int>(std::floor(hi.x))),
          std::min(frame.height - 1, static_cast<int>(std::floor(hi.y)))};
}

/// One line of the exact squared distance transform: lower envelope of parabolas.
/// @param f  Heights in, squared distances out; infinity where there is no parabola.
void transform_line(std::vector<double>& f, std::vector<int>& roots,
                    std::vector<double>& starts, std::vector<double>& out) {
  const int n = static_cast<int>(f.size());
  int last = -1;
  for (int q = 0; q < n; ++q) {
    const auto uq = static_cast<std::size_t>(q);
    if (std::isinf(f[uq])) continue;
    double s = -std::numeric_limits<double>::infinity();
    while (last >= 0) {
      const int r = roots[static_cast<std::size_t>(last)];
      s = ((f[uq] + double(q) * q) - (f[static_cast<std::size_t>(r)] + double(r) * r)) /
          (2.0 * (q - r));
      if (s > starts[static_cast<std::size_t>(last)]) break;
      --last;
      s = -std::numeric_limits<double>::infinity();
    }
    ++last;
    roots[static_cast<std::size_t>(last)] = q;
    starts[static_cast<std::size_t>(last)] = s;
  }
  if (last < 0) return;
  int k = 0;
  for (int q = 0; q < n; ++q) {
    while (k < last && starts[static_cast<std::size_t>(k) + 1] < q) ++k;
    const int r = roots[static_cast<std::size_t>(k)];
    out[static_cast<std::size_t>(q)] =
        double(q - r) * (q - r) + f[static_cast<std::size_t>(r)];
  }
  f.swap(out);
}

}  // namespace

glm::ivec2 GridFrame::cell_of(const glm::dvec2& p_m) const {
  const glm::dvec2 c = (p_m - origin_m) / cell_m;
  return {static_cast<int>(std::floor(c.x)), static_cast<int>(std::floor(c.y))};
}

GridFrame grid_over(const TriangleMesh& mesh, double cell_m, double margin_m) {
  SEGSIM_CHECK(!mesh.positions_m.empty(), "mesh without vertices");
  glm::dvec2 lo(mesh.positions_m[0].x, mesh.positions_m[0].y);
  glm::dvec2 hi = lo;
  for (const glm::vec3& p : mesh.positions_m) {
    lo = glm::min(lo, glm::dvec2(p.x, p.y));
    hi = glm::max(hi, glm::dvec2(p.x, p.y));
  }
  const glm::dvec2 first = glm::floor((lo - margin_m) / cell_m);
  const glm::dvec2 last = glm::ceil((hi + margin_m) / cell_m);
  require_ground_cells(last.x - first.x, last.y - first.y, "collision mesh");
  return {.origin_m = first * cell_m,
          .cell_m = cell_m,
          .width = static_cast<int>(last.x - first.x),
          .height = static_cast<int>(last.y - first.y)};
}

void mark_band(const TriangleMesh& mesh, double z_lo_m, double z_hi_m, const GridFrame& frame,
               GridMask& mask) {
  for (const glm::uvec3& t : mesh.triangles) {
    Polygon polygon = clip_z(triangle_of(mesh, t), z_lo_m, 1.0);
    if (polygon.count > 0) polygon = clip_z(polygon, z_hi_m, -1.0);
    if (polygon.count == 0) continue;
    const CellRange range = cells_around(polygon, frame);
    for (int j = range.j0; j <= range.j1; ++j) {
      for (int i = range.i0; i <= range.i1; ++i) {
        if (mask(i, j) != 0) continue;
        const glm::dvec2 lo = frame.origin_m + frame.cell_m * (glm::dvec2(i, j) - kNudge);
        if (overlaps(polygon, lo, lo + frame.cell_m)) mask(i, j) = 1;
      }
    }
  }
}

void mark_floor(const TriangleMesh& mesh, double z_tolerance_m, const GridFrame& frame,
                GridMask& mask) {
  constexpr double kLevelCosine = 0.866;
  for (const glm::uvec3& t : mesh.triangles) {
    const Polygon triangle = triangle_of(mesh, t);
    double highest = 0.0;
    for (int i = 0; i < 3; ++i) highest = std::max(highest, std::abs(triangle[i].z));
    const glm::dvec3 normal = glm::cross(triangle[1] - triangle[0], triangle[2] - triangle[0]);
    const double length = glm::length(normal);
    if (highest > z_tolerance_m || length <= 0.0 ||
        std::abs(normal.z) < kLevelCosine * length) {
      continue;
    }
    const CellRange range = cells_around(triangle, frame);
    for (int j = range.j0; j <= range.j1; ++j) {
      for (int i = range.i0; i <= range.i1; ++i) {
        // A centre on an edge belongs to both sides: a floor of two triangles has no seam.
        const glm::dvec2 c = frame.center_m(i, j);
        const double tolerance = kNudge * frame.cell_m;
        if (overlaps(triangle, c - tolerance, c + tolerance)) mask(i, j) = 1;
      }
    }
  }
}

core::Image<float> distance_to_marked(const GridMask& mask, double cell_m) {
  const int width = mask.width_px();
  const int height = mask.height_px();
  constexpr double kFar = std::numeric_limits<double>::infinity();
  core::Image<double> squared(width, height, kFar);
  const auto longest = static_cast<std::size_t>(std::max(width, height)) + 1;
  std::vector<int> roots(longest);
  std::vector<double> starts(longest), line, out;

  line.resize(static_cast<std::size_t>(height));
  out.resize(line.size());
  for (int i = 0; i < width; ++i) {
    for (int j = 0; j < height; ++j)
      line[static_cast<std::size_t>(j)] = mask(i, j) != 0 ? 0.0 : kFar;
    transform_line(line, roots, starts, out);
    for (int j = 0; j < height; ++j) squared(i, j) = line[static_cast<std::size_t>(j)];
  }
  line.resize(static_cast<std::size_t>(width));
  out.resize(line.size());
  core::Image<float> distance_m(width, height);
  for (int j = 0; j < height; ++j) {
    std::copy(squared.row(j), squared.row(j) + width, line.begin());
    transform_line(line, roots, starts, out);
    for (int i = 0; i < width; ++i) {
      distance_m(i, j) =
          static_cast<float>(cell_m * std::sqrt(line[static_cast<std::size_t>(i)]));
    }
  }
  return distance_m;
}

core::Image<std::int32_t> label_pieces(const GridMask& mask) {
  const int width = mask.width_px();
  const int height = mask.height_px();
  core::Image<std::int32_t> label(width, height, 0);
  std::vector<std::size_t> sizes;
  std::vector<glm::ivec2> stack;
  for (int j = 0; j < height; ++j) {
    for (int i = 0; i < width; ++i) {
      if (mask(i, j) == 0 || label(i, j) != 0) continue;
      const auto id = static_cast<std::int32_t>(sizes.size() + 1);
      std::size_t size = 0;
      label(i, j) = id;
      stack.assign(1, {i, j});
      while (!stack.empty()) {
        const glm::ivec2 cell = stack.back();
        stack.pop_back();
        ++size;
        constexpr std::array<std::array<int, 2>, 4> kSides = {
            {{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};
        for (const auto& [di, dj] : kSides) {
          const int ni = cell.x + di;
          const int nj = cell.y + dj;
          if (!mask.contains(ni, nj) || mask(ni, nj) == 0 || label(ni, nj) != 0) continue;
          label(ni, nj) = id;
          stack.emplace_back(ni, nj);
        }
      }
      sizes.push_back(size);
    }
  }
  // Rank by size; the sort is stable, so equal sizes keep row order.
  std::vector<std::int32_t> order(sizes.size());
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = static_cast<std::int32_t>(k);
  std::stable_sort(order.begin(), order.end(), [&](std::int32_t a, std::int32_t b) {
    return sizes[static_cast<std::size_t>(a)] > sizes[static_cast<std::size_t>(b)];
  });
  std::vector<std::int32_t> rank(sizes.size() + 1, 0);
  for (std::size_t k = 0; k < order.size(); ++k) {
    rank[static_cast<std::size_t>(order[k]) + 1] = static_cast<std::int32_t>(k + 1);
  }
  for (std::int32_t& value : label.pixels()) value = rank[static_cast<std::size_t>(value)];
  return label;
}

}  // namespace segsim::sim
