#include "reconstruction/upright/surface_elements.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <unordered_map>

#include <Eigen/Dense>
#include <glm/geometric.hpp>

namespace segsim::reconstruction {
namespace {

constexpr double kFewestPoints = 12.0;
/// Variances of the points along the three axes of a patch, ascending: the first is the noise
/// across it, and the second tells a patch from a line.
constexpr double kFlat = 0.1, kWide = 0.2;
constexpr double kOffPlane = 0.35;  ///< Of the voxel's own points from the plane, in voxels.
constexpr std::int64_t kReach = 1 << 20;

using Key = std::uint64_t;

Key key_of(std::int64_t x, std::int64_t y, std::int64_t z) {
  const auto part = [](std::int64_t i) { return static_cast<Key>(i + kReach); };
  return (part(x) << 42U) | (part(y) << 21U) | part(z);
}

/// Sums over points; those of several voxels add up.
struct Moments {
  double count = 0.0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero(), seen_from = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();

  void add(const Eigen::Vector3d& p, const Eigen::Vector3d& from) {
    count += 1.0;
    sum += p;
    seen_from += from;
    squares += p * p.transpose();
  }
  void add(const Moments& other) {
    count += other.count;
    sum += other.sum;
    seen_from += other.seen_from;
    squares += other.squares;
  }
  [[nodiscard]] Eigen::Vector3d mean() const { return sum / count; }
  [[nodiscard]] Eigen::Matrix3d covariance() const {
    return squares / count - mean() * mean().transpose();
  }
};

struct Cell {
  std::int64_t x = 0, y = 0, z = 0;
  Moments moments;
};

struct Grid {
  std::vector<Cell> cells;  ///< In the order of their first points: the same every time.
  std::unordered_map<Key, std::size_t> index;
};

Grid fill_grid(std::span<const SeenPoint> points, double voxel_m) {
  Grid grid;
  for (const SeenPoint& point : points) {
    const glm::dvec3 p(point.position_m), from(point.seen_from_m);
    const glm::dvec3 cell = glm::floor(p / voxel_m);
    const double farthest = std::max({std::abs(cell.x), std::abs(cell.y), std::abs(cell.z)});
    if (!(farthest < static_cast<double>(kReach - 1))) continue;  // Nor what is not finite.
    const auto x = static_cast<std::int64_t>(cell.x), y = static_cast<std::int64_t>(cell.y),
               z = static_cast<std::int64_t>(cell.z);
    const auto [entry, is_new] = grid.index.try_emplace(key_of(x, y, z), grid.cells.size());
    if (is_new) grid.cells.push_back({x, y, z, {}});
    grid.cells[entry->second].moments.add({p.x, p.y, p.z}, {from.x, from.y, from.z});
  }
  return grid;
}

Moments neighbourhood(const Grid& grid, const Cell& cell) {
  Moments sum;
  for (int n = 0; n < 27; ++n) {
    const auto found = grid.index.find(
        key_of(cell.x + n % 3 - 1, cell.y + n / 3 % 3 - 1, cell.z + n / 9 - 1));
    if (found != grid.index.end()) sum.add(grid.cells[found->second].moments);
  }
  return sum;
}

std::optional<SurfaceElement> element_of(const Cell& cell, const Moments& around,
                                         double voxel_m) {
  if (around.count < kFewestPoints) return std::nullopt;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(around.covariance());
  const Eigen::Vector3d& variance = axes.eigenvalues();
  if (!(variance[0] < kFlat * variance[1]) || !(variance[1] > kWide * variance[2])) {
    return std::nullopt;
  }
  Eigen::Vector3d normal = axes.eigenvectors().col(0);
  const Eigen::Vector3d own = cell.moments.mean();
  if (std::abs(normal.dot(own - around.mean())) > kOffPlane * voxel_m) return std::nullopt;
  const Eigen::Vector3d from = cell.moments.seen_from / cell.moments.count;
  if (normal.dot(from - own) < 0.0) normal = -normal;
  return SurfaceElement{{own.x(), own.y(), own.z()}, {normal.x(), normal.y(), normal.z()}};
}

}  // namespace

std::vector<SurfaceElement> surface_elements(std::span<const SeenPoint> points,
                                             double voxel_m) {
  const Grid grid = fill_grid(points, voxel_m);
  std::vector<SurfaceElement> elements;
  for (const Cell& cell : grid.cells) {
    const auto element = element_of(cell, neighbourhood(grid, cell), voxel_m);
    if (element) elements.push_back(*element);
  }
  return elements;
}

}  // namespace segsim::reconstruction
