#include <algorithm>

#include <pcl/filters/voxel_grid.h>
#include <pcl/memory.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>
// The template itself: libpcl_segmentation, which has it compiled, takes 25 MB to load.
#include <pcl/segmentation/impl/extract_clusters.hpp>

#include "nav/objects/dbscan.h"
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

namespace {

/// How far the sums in PCL's tree may be off, and more, as a share of the gap.
constexpr double kRounding = 1e-4;

struct Group {
  std::size_t points = 0;
  int number = 0;
};

/// The group of each point and the number of the largest one, as PCL finds them; -1 if that
/// has fewer than `min_points`.
int largest_group(const std::vector<int>& groups, int min_points) {
  std::vector<Group> found;
  for (const int number : groups) {
    found.resize(std::max(found.size(), static_cast<std::size_t>(number) + 1));
    found[static_cast<std::size_t>(number)].number = number;
    ++found[static_cast<std::size_t>(number)].points;
  }
  std::erase_if(found, [&](const Group& group) {
    return group.points < static_cast<std::size_t>(min_points);
  });
  // PCL's own way to sort, which decides among groups of one size.
  std::sort(found.rbegin(), found.rend(),
            [](const Group& a, const Group& b) { return a.points < b.points; });
  return found.empty() ? -1 : found.front().number;
}

std::vector<glm::vec3> largest_cluster_by_pcl(const std::vector<glm::vec3>& points_m,
                                              double gap_m, int min_points) {
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

}  // namespace

/// Points that hang together are what DBSCAN finds if every point is a core point, and a tree
/// with a search for each of them takes twenty times as long. PCL's distances are rounded to
/// floats: where that may matter it is asked itself.
std::vector<glm::vec3> largest_cluster(const std::vector<glm::vec3>& points_m, double gap_m,
                                       int min_points) {
  if (static_cast<int>(points_m.size()) < min_points || points_m.empty()) return {};
  const auto gap = static_cast<double>(static_cast<float>(gap_m));
  const std::vector<int> groups = dbscan(points_m, gap * (1.0 - kRounding), 1);
  if (groups != dbscan(points_m, gap * (1.0 + kRounding), 1)) {
    return largest_cluster_by_pcl(points_m, gap_m, min_points);
  }
  const int largest = largest_group(groups, min_points);
  std::vector<glm::vec3> cluster;
  for (std::size_t k = 0; k < points_m.size() && largest >= 0; ++k) {
    if (groups[k] == largest) cluster.push_back(points_m[k]);
  }
  return cluster;
}

}  // namespace segsim::nav::internal
