#include <pcl/filters/voxel_grid.h>
#include <pcl/memory.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>
// The template itself: libpcl_segmentation, which has it compiled, takes 25 MB to load.
#include <pcl/segmentation/impl/extract_clusters.hpp>

#include "nav/objects/internal/object_clusters.h"

namespace segsim::nav::internal {
namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

Cloud::Ptr to_pcl(const std::vector<glm::vec3>& points_m) {
  auto cloud = pcl::make_shared<Cloud>();
  cloud->reserve(points_m.size());
  for (const glm::vec3& p : points_m) cloud->push_back({p.x, p.y, p.z});
  return cloud;
}

}  // namespace

std::vector<glm::vec3> thinned(const std::vector<glm::vec3>& points_m, double voxel_m) {
  if (points_m.empty()) return {};
  pcl::VoxelGrid<pcl::PointXYZ> filter;
  filter.setInputCloud(to_pcl(points_m));
  const auto leaf = static_cast<float>(voxel_m);
  filter.setLeafSize(leaf, leaf, leaf);
  Cloud result;
  filter.filter(result);
  std::vector<glm::vec3> thin;
  thin.reserve(result.size());
  for (const pcl::PointXYZ& p : result) thin.emplace_back(p.x, p.y, p.z);
  return thin;
}

std::vector<glm::vec3> largest_cluster(const std::vector<glm::vec3>& points_m, double gap_m,
                                       int min_points) {
  if (static_cast<int>(points_m.size()) < min_points || points_m.empty()) return {};
  const Cloud::Ptr cloud = to_pcl(points_m);
  const auto tree = pcl::make_shared<pcl::search::KdTree<pcl::PointXYZ>>();
  tree->setInputCloud(cloud);
  pcl::EuclideanClusterExtraction<pcl::PointXYZ> extraction;
  extraction.setClusterTolerance(gap_m);
  extraction.setMinClusterSize(min_points);
  extraction.setSearchMethod(tree);
  extraction.setInputCloud(cloud);
  std::vector<pcl::PointIndices> clusters;
  extraction.extract(clusters);
  std::size_t best = 0;
  for (std::size_t k = 1; k < clusters.size(); ++k) {
    if (clusters[k].indices.size() > clusters[best].indices.size()) best = k;
  }
  std::vector<glm::vec3> cluster;
  if (clusters.empty()) return cluster;
  for (const auto index : clusters[best].indices) {
    cluster.push_back(points_m[static_cast<std::size_t>(index)]);
  }
  return cluster;
}

}  // namespace segsim::nav::internal
