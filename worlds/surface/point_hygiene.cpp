#include "worlds/surface/point_hygiene.h"

#include <algorithm>
#include <cmath>

#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/sac_segmentation.h>
#include <glm/geometric.hpp>

namespace segsim::worlds {
namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

/// A plane needs no more points than this to be found.
constexpr std::size_t kEnoughForPlane = 40000;

}  // namespace

std::optional<FloorPlane> find_floor(std::span<const glm::vec3> points_m, double band_m) {
  std::vector<glm::vec3> low;
  for (const glm::vec3& p : points_m) {
    if (std::abs(p.z) <= band_m) low.push_back(p);
  }
  if (low.size() < 100) return std::nullopt;
  const std::size_t stride = std::max<std::size_t>(1, low.size() / kEnoughForPlane);
  const Cloud::Ptr cloud(new Cloud);
  for (std::size_t k = 0; k < low.size(); k += stride) {
    cloud->push_back(pcl::PointXYZ(low[k].x, low[k].y, low[k].z));
  }
  pcl::SACSegmentation<pcl::PointXYZ> segmentation;
  segmentation.setOptimizeCoefficients(true);
  segmentation.setModelType(pcl::SACMODEL_PERPENDICULAR_PLANE);
  segmentation.setAxis(Eigen::Vector3f::UnitZ());
  segmentation.setEpsAngle(0.2);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setMaxIterations(200);
  segmentation.setDistanceThreshold(0.03);
  segmentation.setInputCloud(cloud);
  pcl::PointIndices inliers;
  pcl::ModelCoefficients plane;
  segmentation.segment(inliers, plane);
  if (inliers.indices.size() * 3 < cloud->size()) return std::nullopt;
  glm::dvec3 mean(0.0);
  for (const int index : inliers.indices) {
    const pcl::PointXYZ& p = (*cloud)[static_cast<std::size_t>(index)];
    mean += glm::dvec3(p.x, p.y, p.z) / static_cast<double>(inliers.indices.size());
  }
  glm::dvec3 normal =
      glm::normalize(glm::dvec3(plane.values[0], plane.values[1], plane.values[2]));
  if (normal.z < 0.0) normal = -normal;
  FloorPlane floor;
  floor.height_m = mean.z;
  // Not acos(normal.z): that is blind below 5e-4.
  floor.tilt_rad = std::atan2(std::hypot(normal.x, normal.y), normal.z);
  floor.normal = normal;
  floor.origin_height_m = glm::dot(normal, mean) / normal.z;
  floor.inliers = inliers.indices.size();
  return floor;
}

std::vector<std::size_t> without_outliers(std::span<const glm::vec3> points_m, int neighbors,
                                          double deviations) {
  std::vector<std::size_t> kept;
  if (neighbors <= 0 || points_m.size() <= static_cast<std::size_t>(neighbors)) {
    for (std::size_t k = 0; k < points_m.size(); ++k) kept.push_back(k);
    return kept;
  }
  const Cloud::Ptr cloud(new Cloud);
  cloud->reserve(points_m.size());
  for (const glm::vec3& p : points_m) cloud->push_back(pcl::PointXYZ(p.x, p.y, p.z));
  pcl::StatisticalOutlierRemoval<pcl::PointXYZ> filter;
  filter.setInputCloud(cloud);
  filter.setMeanK(neighbors);
  filter.setStddevMulThresh(deviations);
  std::vector<int> indices;
  filter.filter(indices);
  std::sort(indices.begin(), indices.end());
  kept.assign(indices.begin(), indices.end());
  return kept;
}

}  // namespace segsim::worlds
