#include "reconstruction/lifting/internal/voxel_surfels.h"

#include <algorithm>
#include <cmath>

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <Eigen/Dense>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>

#include "renderer/scene/parallel.h"

namespace segsim::reconstruction::internal {
namespace {

/// Sigma of a surfel in units of the local spacing: the middle of four surfels at the corners
/// of a square keeps 97 % alpha at opacity 0.95.
constexpr float kSigmaPerSpacing = 0.72F;
constexpr float kSmallestSigma_voxels = 0.45F, kLargestSigma_voxels = 1.4F;
constexpr float kSmallestAspect = 0.4F;
constexpr double kOutlierSigmas = 4.0;

struct Neighborhood {
  glm::mat3 axes{1.0F};  ///< Columns t_u, t_v, normal; right-handed.
  glm::vec2 sigma_m{0.0F};
  glm::vec3 color{0.5F};
  float mean_distance_m = 0.0F;
};

glm::vec3 to_glm(const Eigen::Vector3d& v) { return glm::vec3(v.x(), v.y(), v.z()); }

/// Tangent for a normal without preferred direction.
glm::vec3 any_tangent(const glm::vec3& normal) {
  const glm::vec3 axis = std::abs(normal.z) < 0.9F ? glm::vec3(0, 0, 1) : glm::vec3(1, 0, 0);
  return glm::normalize(glm::cross(axis, normal));
}

class SurfelMaker {
 public:
  SurfelMaker(const std::vector<Voxel>& voxels, const LiftOptions& options)
      : voxels_(voxels), options_(options), voxel_m_(static_cast<float>(options.voxel_m)) {
    cloud_.reset(new pcl::PointCloud<pcl::PointXYZ>);
    cloud_->reserve(voxels.size());
    for (const Voxel& voxel : voxels) {
      const glm::vec3 p = voxel.position_m(voxel_m_);
      cloud_->push_back(pcl::PointXYZ(p.x, p.y, p.z));
    }
    tree_.setInputCloud(cloud_);
  }

  [[nodiscard]] glm::vec3 position_m(std::size_t i) const {
    const pcl::PointXYZ& p = (*cloud_)[i];
    return {p.x, p.y, p.z};
  }

  [[nodiscard]] Neighborhood look(std::size_t i) const;

 private:
  void set_axes(const Eigen::Matrix3d& covariance, const glm::vec3& facing,
                Neighborhood& result) const;

  const std::vector<Voxel>& voxels_;
  const LiftOptions& options_;
  float voxel_m_;
  pcl::PointCloud<pcl::PointXYZ>::Ptr cloud_;
  pcl::search::KdTree<pcl::PointXYZ> tree_;
};

void SurfelMaker::set_axes(const Eigen::Matrix3d& covariance, const glm::vec3& facing,
                           Neighborhood& result) const {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(covariance);
  const Eigen::Vector3d spread = solver.eigenvalues().cwiseMax(0.0);
  glm::vec3 normal = to_glm(solver.eigenvectors().col(0));
  glm::vec3 tangent = to_glm(solver.eigenvectors().col(2));
  if (glm::dot(normal, facing) < 0.0F) normal = -normal;
  // No plane, or one that contradicts what the cameras saw: keep the measured normal.
  if (!(spread[0] < 0.5 * spread[1]) || glm::dot(normal, facing) < 0.5F) {
    normal = facing;
    tangent -= glm::dot(tangent, normal) * normal;
    tangent = glm::length(tangent) > 0.1F ? glm::normalize(tangent) : any_tangent(normal);
  }
  normal = glm::normalize(normal);
  tangent = glm::normalize(tangent - glm::dot(tangent, normal) * normal);
  result.axes = glm::mat3(tangent, glm::cross(normal, tangent), normal);
  // Along lines (chair legs, edges) the disc is narrowed.
  const double aspect = std::sqrt(spread[1] / std::max(spread[2], 1e-12));
  const float narrow = std::clamp(2.0F * static_cast<float>(aspect), kSmallestAspect, 1.0F);
  result.sigma_m.y *= narrow;
}

Neighborhood SurfelMaker::look(std::size_t i) const {
  thread_local pcl::Indices found;
  thread_local std::vector<float> squared;
  const int wanted = std::max(4, options_.neighbors) + 1;
  tree_.nearestKSearch((*cloud_)[i], wanted, found, squared);

  const glm::vec3 center = position_m(i);
  const glm::vec3 facing = glm::normalize(voxels_[i].normal_sum);
  const float reach = 3.0F * voxel_m_;
  Neighborhood result;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  double total = 0.0;
  int inside = 0;
  float farthest = 0.0F;
  for (std::size_t k = 0; k < found.size(); ++k) {
    const auto n = static_cast<std::size_t>(found[k]);
    const float distance = std::sqrt(squared[k]);
    result.mean_distance_m += distance / static_cast<float>(wanted - 1);
    const float agreement = glm::dot(glm::normalize(voxels_[n].normal_sum), facing);
    if (agreement < 0.3F || distance > reach) continue;
    const double w = agreement * agreement * std::exp(-squared[k] / (reach * reach));
    const glm::vec3 d = position_m(n) - center;
    const Eigen::Vector3d e(d.x, d.y, d.z);
    sum += w * e;
    squares += w * e * e.transpose();
    total += w;
    ++inside;
    farthest = std::max(farthest, distance);
  }
  // Area per neighbour gives the spacing; a lone voxel keeps the voxel size.
  float spacing = voxel_m_;
  if (inside >= 4) {
    spacing = farthest * std::sqrt(3.14159265F / static_cast<float>(inside));
  }
  const float sigma = std::clamp(kSigmaPerSpacing * spacing, kSmallestSigma_voxels * voxel_m_,
                                 kLargestSigma_voxels * voxel_m_);
  result.sigma_m = glm::vec2(sigma);
  const Eigen::Vector3d mean = sum / total;
  if (inside >= 4) {
    set_axes(squares / total - mean * mean.transpose(), facing, result);
  } else {
    const glm::vec3 tangent = any_tangent(facing);
    result.axes = glm::mat3(tangent, glm::cross(facing, tangent), facing);
  }
  result.color = voxels_[i].color();
  return result;
}

/// Largest mean neighbour distance of an inlier (as PCL's StatisticalOutlierRemoval decides).
float outlier_limit_m(const std::vector<Neighborhood>& all) {
  double sum = 0.0, squares = 0.0;
  for (const Neighborhood& one : all) {
    sum += one.mean_distance_m;
    squares += static_cast<double>(one.mean_distance_m) * one.mean_distance_m;
  }
  const auto n = static_cast<double>(all.size());
  const double mean = sum / n;
  return static_cast<float>(mean + kOutlierSigmas *
                                       std::sqrt(std::max(0.0, squares / n - mean * mean)));
}

}  // namespace

renderer::SurfelCloud make_surfels(const std::vector<Voxel>& voxels,
                                   const LiftOptions& options, bool with_labels,
                                   SurfelReport& report) {
  renderer::SurfelCloud cloud;
  if (voxels.empty()) return cloud;
  const SurfelMaker maker(voxels, options);
  std::vector<Neighborhood> all(voxels.size());
  renderer::internal::parallel_for_each(voxels.size(), 4096,
                                        [&](std::size_t i) { all[i] = maker.look(i); });
  const float limit_m =
      std::max(outlier_limit_m(all), 2.0F * static_cast<float>(options.voxel_m));
  double agreement = 0.0;
  std::size_t labelled = 0;
  for (std::size_t i = 0; i < voxels.size(); ++i) {
    if (all[i].mean_distance_m > limit_m) {
      ++report.outliers;
      continue;
    }
    cloud.position_m.push_back(maker.position_m(i));
    cloud.R_world_surfel.push_back(glm::normalize(glm::quat_cast(all[i].axes)));
    cloud.scale_m.push_back(all[i].sigma_m);
    cloud.opacity.push_back(static_cast<float>(options.opacity));
    cloud.sh.push_back((glm::clamp(all[i].color, 0.0F, 1.0F) - 0.5F) / renderer::kShC0);
    if (!with_labels) continue;
    const LabelVotes& votes = voxels[i].labels;
    const int winner = votes.winner();
    cloud.semantic_id.push_back(static_cast<std::uint16_t>(votes.label[winner] >> 16U));
    cloud.instance_id.push_back(static_cast<std::uint16_t>(votes.label[winner] & 0xFFFFU));
    if (votes.label[winner] != 0) {
      agreement += votes.votes[winner] / votes.total;
      ++labelled;
    }
  }
  report.label_agreement = labelled > 0 ? agreement / static_cast<double>(labelled) : 0.0;
  return cloud;
}

}  // namespace segsim::reconstruction::internal
