#include "reconstruction/lifting/internal/plane_filling.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include <pcl/ModelCoefficients.h>
#include <pcl/PointIndices.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/sac_segmentation.h>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>

namespace segsim::reconstruction::internal {
namespace {

constexpr int kPlanes = 16;
constexpr std::size_t kSearchPoints = 30000;
constexpr double kSmallestShare = 0.012;  // Of the search points, for a plane to be filled.
constexpr float kThickness_voxels = 2.2F;
constexpr float kCoverRadius_voxels = 1.1F;
constexpr int kGrowRounds = 14;
constexpr double kSmallestArea_m2 = 0.4;  // A plane through a ball's cap is smaller.
// Occupied ones among the 8 neighbours. A straight border offers 3, so only bays and holes
// grow.
constexpr int kFewestSides = 4;
constexpr std::int64_t kMostCells = 4'000'000;

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

struct Plane {
  glm::vec3 normal{0.0F};
  float offset_m = 0.0F;  ///< normal . p + offset = 0
};

/// Largest plane of the cloud; its points are removed from it.
std::optional<Plane> take_largest_plane(Cloud::Ptr& cloud, std::size_t fewest,
                                        float tolerance_m) {
  pcl::SACSegmentation<pcl::PointXYZ> segmentation;
  segmentation.setModelType(pcl::SACMODEL_PLANE);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setDistanceThreshold(tolerance_m);
  segmentation.setMaxIterations(300);
  segmentation.setOptimizeCoefficients(true);
  segmentation.setInputCloud(cloud);
  pcl::PointIndices inliers;
  pcl::ModelCoefficients model;
  segmentation.segment(inliers, model);
  if (inliers.indices.size() < fewest || model.values.size() != 4) return std::nullopt;
  std::vector<bool> taken(cloud->size(), false);
  for (const int i : inliers.indices) taken[static_cast<std::size_t>(i)] = true;
  Cloud::Ptr rest(new Cloud);
  for (std::size_t i = 0; i < taken.size(); ++i) {
    if (!taken[i]) rest->push_back((*cloud)[i]);
  }
  cloud = rest;
  return Plane{{model.values[0], model.values[1], model.values[2]}, model.values[3]};
}

/// The voxels of one side of a plane, drawn in a grid on it.
class PlaneGrid {
 public:
  PlaneGrid(const std::vector<Voxel>& voxels, const Plane& plane, float voxel_m);
  /// Cells that growth fills, as voxels with the mean attributes of the cells they grew from.
  [[nodiscard]] std::vector<Voxel> grow(const FreeSpace& free_space) const;

 private:
  [[nodiscard]] glm::ivec2 cell_of(const glm::vec3& p) const {
    return glm::ivec2(static_cast<int>(std::floor(glm::dot(p, axis_u_) / voxel_m_)) - low_.x,
                      static_cast<int>(std::floor(glm::dot(p, axis_v_) / voxel_m_)) - low_.y);
  }
  [[nodiscard]] glm::vec3 center_m(const glm::ivec2& cell) const {
    const glm::vec2 uv = (glm::vec2(cell + low_) + 0.5F) * voxel_m_;
    return axis_u_ * uv.x + axis_v_ * uv.y - plane_.normal * plane_.offset_m;
  }
  [[nodiscard]] std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(size_.x) +
           static_cast<std::size_t>(x);
  }
  /// Enters a voxel in all cells that its surfel covers: the grid is turned against the
  /// voxels, and without this a dense surface would show empty cells.
  void cover(const Voxel& voxel);
  [[nodiscard]] Voxel blend(const std::vector<Voxel>& cells, int x, int y, int& sides) const;

  Plane plane_;
  float voxel_m_;
  glm::vec3 axis_u_{0.0F}, axis_v_{0.0F};
  glm::ivec2 low_{0}, size_{0};
  std::vector<Voxel> cells_;  ///< weight 0 = empty.
};

PlaneGrid::PlaneGrid(const std::vector<Voxel>& voxels, const Plane& plane, float voxel_m)
    : plane_(plane), voxel_m_(voxel_m) {
  const glm::vec3 up =
      std::abs(plane.normal.z) < 0.9F ? glm::vec3(0, 0, 1) : glm::vec3(1, 0, 0);
  axis_u_ = glm::normalize(glm::cross(up, plane.normal));
  axis_v_ = glm::cross(plane.normal, axis_u_);
  std::vector<std::size_t> members;
  glm::ivec2 high(std::numeric_limits<int>::min());
  glm::ivec2 low(std::numeric_limits<int>::max());
  for (std::size_t i = 0; i < voxels.size(); ++i) {
    const glm::vec3 p = voxels[i].position_m(voxel_m);
    const float distance = glm::dot(plane.normal, p) + plane.offset_m;
    if (std::abs(distance) > kThickness_voxels * voxel_m) continue;
    if (glm::dot(glm::normalize(voxels[i].normal_sum), plane.normal) < 0.8F) continue;
    members.push_back(i);
    const glm::ivec2 cell = cell_of(p);
    low = glm::ivec2(std::min(low.x, cell.x), std::min(low.y, cell.y));
    high = glm::ivec2(std::max(high.x, cell.x), std::max(high.y, cell.y));
  }
  if (members.empty()) return;
  const glm::ivec2 size = high - low + 1;
  if (static_cast<std::int64_t>(size.x) * size.y > kMostCells) return;
  low_ = low;
  size_ = size;
  cells_.resize(static_cast<std::size_t>(size.x) * static_cast<std::size_t>(size.y));
  for (const std::size_t i : members) cover(voxels[i]);
}

void PlaneGrid::cover(const Voxel& voxel) {
  const glm::vec3 p = voxel.position_m(voxel_m_);
  const glm::ivec2 cell = cell_of(p);
  for (int k = 0; k < 9; ++k) {
    const glm::ivec2 target_cell = cell + glm::ivec2(k % 3 - 1, k / 3 - 1);
    if (target_cell.x < 0 || target_cell.y < 0 || target_cell.x >= size_.x ||
        target_cell.y >= size_.y) {
      continue;
    }
    const glm::vec3 d = center_m(target_cell) - p;
    const float in_plane = glm::length(d - glm::dot(d, plane_.normal) * plane_.normal);
    if (in_plane > kCoverRadius_voxels * voxel_m_) continue;
    Voxel& target = cells_[at(target_cell.x, target_cell.y)];
    if (voxel.weight > target.weight) target = voxel;
  }
}

Voxel PlaneGrid::blend(const std::vector<Voxel>& cells, int x, int y, int& sides) const {
  Voxel result;
  sides = 0;
  for (int k = 0; k < 9; ++k) {
    const int nx = x + k % 3 - 1, ny = y + k / 3 - 1;
    if (nx < 0 || ny < 0 || nx >= size_.x || ny >= size_.y) continue;
    const Voxel& neighbor = cells[at(nx, ny)];
    if (!(neighbor.weight > 0.0F)) continue;
    ++sides;
    result.color_sum += neighbor.color();
    result.color_weight += 1.0F;
    result.normal_sum += glm::normalize(neighbor.normal_sum);
    const int winner = neighbor.labels.winner();
    result.labels.add(neighbor.labels.label[winner], 1.0F);
  }
  result.observations = 1;
  return result;
}

std::vector<Voxel> PlaneGrid::grow(const FreeSpace& free_space) const {
  std::vector<Voxel> filled;
  std::vector<Voxel> cells = cells_;
  std::vector<bool> refused(cells.size(), false);
  for (int round = 0; round < kGrowRounds; ++round) {
    std::vector<std::pair<std::size_t, Voxel>> added;
    for (int y = 0; y < size_.y; ++y) {
      for (int x = 0; x < size_.x; ++x) {
        if (cells[at(x, y)].weight > 0.0F || refused[at(x, y)]) continue;
        int sides = 0;
        Voxel voxel = blend(cells, x, y, sides);
        if (sides < kFewestSides) continue;
        const glm::vec3 position = center_m({x, y});
        if (free_space.at(position).through > 0) {
          refused[at(x, y)] = true;
          continue;
        }
        voxel.key = voxel_key_at(position, voxel_m_);
        voxel.weight = 1e-3F;
        voxel.position_sum =
            voxel.weight * (position - glm::vec3(voxel_cell(voxel.key)) * voxel_m_);
        added.emplace_back(at(x, y), voxel);
      }
    }
    if (added.empty()) break;
    for (auto& [cell, voxel] : added) {
      cells[cell] = voxel;
      filled.push_back(voxel);
    }
  }
  return filled;
}

}  // namespace

std::size_t fill_planes(std::vector<Voxel>& voxels, const FreeSpace& free_space,
                        float voxel_m) {
  Cloud::Ptr cloud(new Cloud);
  const std::size_t step = std::max<std::size_t>(1, voxels.size() / kSearchPoints);
  for (std::size_t i = 0; i < voxels.size(); i += step) {
    const glm::vec3 p = voxels[i].position_m(voxel_m);
    cloud->push_back(pcl::PointXYZ(p.x, p.y, p.z));
  }
  const double points_per_m2 =
      1.0 / (static_cast<double>(step) * static_cast<double>(voxel_m) *
             static_cast<double>(voxel_m));
  const auto fewest = static_cast<std::size_t>(
      std::max({50.0, kSmallestShare * static_cast<double>(cloud->size()),
                kSmallestArea_m2 * points_per_m2}));
  VoxelTable table;
  for (const Voxel& voxel : voxels) table.at(voxel.key) = voxel;
  const std::size_t before = voxels.size();
  for (int k = 0; k < kPlanes && cloud->size() > fewest; ++k) {
    const std::optional<Plane> plane = take_largest_plane(cloud, fewest, 1.2F * voxel_m);
    if (!plane) break;
    for (const float side : {1.0F, -1.0F}) {
      const PlaneGrid grid(voxels, {side * plane->normal, side * plane->offset_m}, voxel_m);
      for (const Voxel& voxel : grid.grow(free_space)) {
        if (table.find(voxel.key) < 0) table.at(voxel.key) = voxel;
      }
    }
  }
  voxels = table.take();
  std::sort(voxels.begin(), voxels.end(),
            [](const Voxel& a, const Voxel& b) { return a.key < b.key; });
  return voxels.size() - before;
}

}  // namespace segsim::reconstruction::internal
