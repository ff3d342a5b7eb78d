#include "reconstruction/datasets/floor_fit.h"

#include <algorithm>
#include <vector>

#include <pcl/ModelCoefficients.h>
#include <pcl/PointIndices.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/sac_segmentation.h>

namespace segsim::reconstruction {
namespace {

constexpr float kInlierDistance_m = 0.025F;
constexpr double kLargestTilt_rad = 0.14;
constexpr int kPlanes = 6;
constexpr double kSmallestShare = 0.03;      // Of all points, for a plane to count.
constexpr float kBelow_m = 0.10F;            // Points deeper than this lie below a plane ...
constexpr double kLargestBelowShare = 0.02;  // ... and a floor has at most this share of them.

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

float median_z(std::vector<float> heights) {
  const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::nth_element(heights.begin(), middle, heights.end());
  return *middle;
}

/// Inliers of the largest horizontal plane; empty if none is found. PCL's RANSAC starts from a
/// fixed seed, so equal clouds give equal planes.
std::vector<int> largest_horizontal_plane(const Cloud::Ptr& cloud) {
  pcl::SACSegmentation<pcl::PointXYZ> segmentation;
  segmentation.setModelType(pcl::SACMODEL_PERPENDICULAR_PLANE);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setAxis(Eigen::Vector3f(0.0F, 0.0F, 1.0F));
  segmentation.setEpsAngle(kLargestTilt_rad);
  segmentation.setDistanceThreshold(kInlierDistance_m);
  segmentation.setMaxIterations(800);
  segmentation.setOptimizeCoefficients(true);
  segmentation.setInputCloud(cloud);
  pcl::PointIndices inliers;
  pcl::ModelCoefficients plane;
  segmentation.segment(inliers, plane);
  return std::vector<int>(inliers.indices.begin(), inliers.indices.end());
}

}  // namespace

std::optional<double> fit_floor_height_m(std::span<const glm::vec3> points_m) {
  const double total = static_cast<double>(points_m.size());
  Cloud::Ptr cloud(new Cloud);
  for (const glm::vec3& p : points_m) cloud->push_back(pcl::PointXYZ(p.x, p.y, p.z));

  std::optional<double> lowest;
  for (int plane = 0; plane < kPlanes && cloud->size() >= 50; ++plane) {
    const std::vector<int> inliers = largest_horizontal_plane(cloud);
    if (static_cast<double>(inliers.size()) < std::max(30.0, kSmallestShare * total)) break;
    std::vector<float> heights;
    std::vector<bool> taken(cloud->size(), false);
    for (const int i : inliers) {
      heights.push_back((*cloud)[static_cast<std::size_t>(i)].z);
      taken[static_cast<std::size_t>(i)] = true;
    }
    const float height = median_z(std::move(heights));
    const auto below =
        std::count_if(points_m.begin(), points_m.end(),
                      [&](const glm::vec3& p) { return p.z < height - kBelow_m; });
    if (static_cast<double>(below) <= kLargestBelowShare * total) {
      lowest = std::min(lowest.value_or(height), static_cast<double>(height));
    }
    Cloud::Ptr rest(new Cloud);
    for (std::size_t i = 0; i < taken.size(); ++i) {
      if (!taken[i]) rest->push_back((*cloud)[i]);
    }
    cloud = rest;
  }
  return lowest;
}

}  // namespace segsim::reconstruction
