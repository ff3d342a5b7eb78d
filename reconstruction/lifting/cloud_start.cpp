#include "reconstruction/lifting/cloud_start.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>

#include <tbb/task_arena.h>

#include <pcl/features/normal_3d.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>

#include "core/check.h"
#include "core/error.h"
#include "reconstruction/lifting/internal/voxel_fusion.h"
#include "reconstruction/lifting/internal/voxel_surfels.h"
#include "reconstruction/lifting/parallel_loading.h"
#include "renderer/scene/parallel.h"

namespace segsim::reconstruction {
namespace {

using internal::Voxel;

constexpr std::size_t kFewestVoxels = 4;  ///< Three span a plane; four have a normal.
constexpr double kSmallestSeenShare = 0.01;
constexpr int kViews = 3;  ///< Of which a colour is the mean.
constexpr float kNearest_m = 0.05F;
constexpr int kCell_px = 4;  ///< Pixels of a cell of the depth test.
constexpr int kLargestSplat_cells = 8;
/// A point this much behind the nearest of its cell is hidden: surfaces slant.
constexpr float kSlack_voxels = 2.0F, kSlackRatio = 0.02F;

/// What a frame says about a point.
struct Sight {
  float distance_m = std::numeric_limits<float>::infinity();
  glm::vec3 color{0.0F};
};

/// The nearest views of a point, nearest first; those of one distance in order of frames.
struct Sights {
  std::array<Sight, kViews> nearest;
  glm::vec3 camera_m{0.0F};  ///< Of the nearest.

  void add(const Sight& sight, const glm::vec3& from_m) {
    if (sight.distance_m < nearest[0].distance_m) camera_m = from_m;
    Sight moved = sight;
    for (Sight& slot : nearest) {
      if (moved.distance_m < slot.distance_m) std::swap(moved, slot);
    }
  }
  [[nodiscard]] bool any() const { return std::isfinite(nearest[0].distance_m); }
  /// Mean of the views, nearer ones more.
  [[nodiscard]] glm::vec3 color() const {
    glm::vec3 sum(0.0F);
    float total = 0.0F;
    for (const Sight& sight : nearest) {
      if (!std::isfinite(sight.distance_m)) continue;
      const float weight = 1.0F / (sight.distance_m * sight.distance_m);
      sum += weight * sight.color;
      total += weight;
    }
    return sum / total;
  }
};

/// The cloud as a camera sees it: which points are in front.
class CloudView {
 public:
  CloudView(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& camera,
            float voxel_m)
      : camera_(camera),
        R_camera_world_(glm::mat3_cast(glm::inverse(T_world_camera.rotation()))),
        centre_m_(T_world_camera.translation_m()),
        voxel_m_(voxel_m),
        cells_x_((camera.width_px + kCell_px - 1) / kCell_px),
        cells_y_((camera.height_px + kCell_px - 1) / kCell_px),
        nearest_m_(cells_x_, cells_y_, std::numeric_limits<float>::infinity()) {}

  [[nodiscard]] const glm::vec3& centre_m() const { return centre_m_; }

  void draw(const glm::vec3& p_m) {
    const glm::vec3 p = in_camera(p_m);
    if (p.z < kNearest_m) return;
    const glm::dvec2 px = camera_.project(p);
    const double reach_px = 0.5 * static_cast<double>(voxel_m_) * camera_.fx_px / p.z;
    const double cells = std::min<double>(reach_px / kCell_px, kLargestSplat_cells);
    const double x = px.x / kCell_px, y = px.y / kCell_px;
    if (!(x + cells >= 0.0 && y + cells >= 0.0 && x - cells < cells_x_ &&
          y - cells < cells_y_)) {
      return;
    }
    const int x_end = std::min(static_cast<int>(x + cells), cells_x_ - 1);
    const int y_end = std::min(static_cast<int>(y + cells), cells_y_ - 1);
    for (int cy = std::max(static_cast<int>(y - cells), 0); cy <= y_end; ++cy) {
      for (int cx = std::max(static_cast<int>(x - cells), 0); cx <= x_end; ++cx) {
        nearest_m_(cx, cy) = std::min(nearest_m_(cx, cy), p.z);
      }
    }
  }

  /// The pixel that shows the point; none if it is outside or hidden.
  [[nodiscard]] std::optional<glm::ivec2> pixel_of(const glm::vec3& p_m) const {
    const glm::vec3 p = in_camera(p_m);
    if (p.z < kNearest_m) return std::nullopt;
    const glm::dvec2 px = camera_.project(p);
    if (!(px.x >= 0.0 && px.y >= 0.0 && px.x < camera_.width_px && px.y < camera_.height_px)) {
      return std::nullopt;
    }
    const glm::ivec2 pixel(px);
    const float front_m = nearest_m_(pixel.x / kCell_px, pixel.y / kCell_px);
    if (p.z > front_m * (1.0F + kSlackRatio) + kSlack_voxels * voxel_m_) return std::nullopt;
    return pixel;
  }

 private:
  [[nodiscard]] glm::vec3 in_camera(const glm::vec3& p_m) const {
    return R_camera_world_ * (p_m - centre_m_);
  }

  core::CameraIntrinsics camera_;
  glm::mat3 R_camera_world_;
  glm::vec3 centre_m_;
  float voxel_m_;
  int cells_x_, cells_y_;
  core::Image<float> nearest_m_;
};

/// Runs the stages and reports them.
class CloudStart {
 public:
  CloudStart(const PointCloud& cloud, const RgbdSequence& sequence, const LiftOptions& options,
             const LiftProgress& progress)
      : cloud_(cloud),
        sequence_(sequence),
        options_(options),
        progress_(progress),
        voxel_m_(static_cast<float>(options.voxel_m)),
        frames_(split_frames(sequence.frame_count(), options.frame_step,
                             options.held_out_every)) {}

  LiftResult run();

 private:
  /// One voxel for each that has points, without normals; ascending by key.
  [[nodiscard]] std::vector<Voxel> thin() const;
  /// What the frames see of the points.
  [[nodiscard]] std::vector<Sights> look(const std::vector<glm::vec3>& points_m) const;
  /// Normals towards the nearest camera that sees the point, or the nearest at all.
  void orient(std::vector<Voxel>& voxels, const std::vector<glm::vec3>& points_m,
              const std::vector<Sights>& sights) const;
  [[nodiscard]] glm::vec3 nearest_camera_m(const glm::vec3& p_m) const;
  void report(const std::string& stage, std::size_t done, std::size_t total) const {
    if (progress_) {
      progress_(stage, static_cast<std::int64_t>(done), static_cast<std::int64_t>(total));
    }
  }

  const PointCloud& cloud_;
  const RgbdSequence& sequence_;
  const LiftOptions& options_;
  const LiftProgress& progress_;
  float voxel_m_;
  FrameSplit frames_;
};

std::vector<Voxel> CloudStart::thin() const {
  const auto T_world_source = sequence_.T_world_source();
  internal::FrameSamples points;
  points.samples.reserve(cloud_.position_m.size());
  const float farthest_m = 0.99F * static_cast<float>(internal::kVoxelRange) * voxel_m_;
  for (std::size_t i = 0; i < cloud_.position_m.size(); ++i) {
    internal::LiftSample sample{};
    sample.position_m = glm::vec3(
        (T_world_source * core::Point<core::frame::World>{cloud_.position_m[i]}).xyz_m);
    if (!(std::abs(sample.position_m.x) < farthest_m &&
          std::abs(sample.position_m.y) < farthest_m &&
          std::abs(sample.position_m.z) < farthest_m)) {
      continue;  // Kilometres away: no key, and nothing of this place.
    }
    if (!cloud_.rgb.empty()) {
      const core::Rgb8& rgb = cloud_.rgb[i];
      sample.color = glm::vec3(rgb.r, rgb.g, rgb.b) / 255.0F;
    }
    sample.weight = sample.color_weight = 1.0F;
    points.samples.push_back(sample);
  }
  internal::VoxelFusion fusion(voxel_m_);
  fusion.add({&points, 1});
  return fusion.take_sorted();
}

std::vector<Sights> CloudStart::look(const std::vector<glm::vec3>& points_m) const {
  std::vector<Sights> sights(points_m.size());
  const std::size_t frame_count = frames_.used.size();
  for (std::size_t first = 0; first < frame_count; first += internal::kFramesInMemory) {
    const std::size_t count = std::min(internal::kFramesInMemory, frame_count - first);
    std::vector<RgbdFrame> frames(count);
    std::vector<std::optional<CloudView>> views(count);
    internal::load_each(count, [&](std::size_t k) {
      frames[k] = sequence_.load(frames_.used[first + k]);
      views[k].emplace(frames[k].T_world_camera, sequence_.intrinsics(), voxel_m_);
      for (const glm::vec3& p_m : points_m) views[k]->draw(p_m);
    });
    renderer::internal::parallel_for_each(points_m.size(), 4096, [&](std::size_t i) {
      for (std::size_t k = 0; k < count; ++k) {
        const std::optional<glm::ivec2> px = views[k]->pixel_of(points_m[i]);
        if (!px || (!frames[k].valid.empty() && frames[k].valid(px->x, px->y) == 0)) continue;
        const core::Rgb8& rgb = frames[k].rgb(px->x, px->y);
        sights[i].add({glm::distance(points_m[i], views[k]->centre_m()),
                       glm::vec3(rgb.r, rgb.g, rgb.b) / 255.0F},
                      views[k]->centre_m());
      }
    });
    report("looking at the cloud", first + count, frame_count);
  }
  return sights;
}

glm::vec3 CloudStart::nearest_camera_m(const glm::vec3& p_m) const {
  glm::vec3 nearest_m(0.0F);
  float squared = std::numeric_limits<float>::infinity();
  for (const std::size_t i : frames_.used) {
    const glm::vec3 camera_m(sequence_.pose(i).translation_m());
    const glm::vec3 d_m = camera_m - p_m;
    if (glm::dot(d_m, d_m) < squared) nearest_m = camera_m, squared = glm::dot(d_m, d_m);
  }
  return nearest_m;
}

void CloudStart::orient(std::vector<Voxel>& voxels, const std::vector<glm::vec3>& points_m,
                        const std::vector<Sights>& sights) const {
  const pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>);
  cloud->reserve(points_m.size());
  for (const glm::vec3& p : points_m) cloud->push_back(pcl::PointXYZ(p.x, p.y, p.z));
  pcl::search::KdTree<pcl::PointXYZ> tree;
  tree.setInputCloud(cloud);
  const int neighbors = std::max(options_.neighbors, 3) + 1;
  renderer::internal::parallel_for_each(voxels.size(), 1024, [&](std::size_t i) {
    thread_local pcl::Indices found;
    thread_local std::vector<float> squared;
    tree.nearestKSearch((*cloud)[i], neighbors, found, squared);
    const glm::vec3 camera_m =
        sights[i].any() ? sights[i].camera_m : nearest_camera_m(points_m[i]);
    const glm::vec3 to_camera = camera_m - points_m[i];
    Eigen::Vector4f plane = Eigen::Vector4f::Zero();
    float curvature = 0.0F;
    const bool known = pcl::computePointNormal(*cloud, found, plane, curvature);
    glm::vec3 normal(plane.x(), plane.y(), plane.z());
    if (!known || !(glm::dot(normal, normal) > 0.5F)) {
      normal = glm::length(to_camera) > 0.0F ? glm::normalize(to_camera) : glm::vec3(0, 0, 1);
    }
    voxels[i].normal_sum = glm::dot(normal, to_camera) < 0.0F ? -normal : normal;
  });
}

LiftResult CloudStart::run() {
  const auto start = std::chrono::steady_clock::now();
  LiftResult result;
  LiftStatistics& statistics = result.statistics;
  std::vector<Voxel> voxels = thin();
  statistics.frames_used = frames_.used.size();
  statistics.frames_held_out = frames_.held_out.size();
  statistics.voxels = voxels.size();
  const std::string place = sequence_.name() + ", start from a cloud";
  if (voxels.size() < kFewestVoxels) {
    throw core::InputError::expected(place, "points in at least 4 voxels",
                                     std::to_string(voxels.size()));
  }
  std::vector<glm::vec3> points_m;
  points_m.reserve(voxels.size());
  for (const Voxel& voxel : voxels) points_m.push_back(voxel.position_m(voxel_m_));
  const std::vector<Sights> sights = look(points_m);
  const auto seen = static_cast<std::size_t>(
      std::count_if(sights.begin(), sights.end(), [](const Sights& s) { return s.any(); }));
  if (static_cast<double>(seen) < kSmallestSeenShare * static_cast<double>(voxels.size())) {
    throw core::InputError::expected(
        place, "a cloud in the coordinates of the recording's poses",
        std::to_string(seen) + " of " + std::to_string(voxels.size()) +
            " voxels where the frames look");
  }
  orient(voxels, points_m, sights);
  if (cloud_.rgb.empty()) {
    for (std::size_t i = 0; i < voxels.size(); ++i) {
      voxels[i].color_sum = sights[i].any() ? sights[i].color() : glm::vec3(0.5F);
      voxels[i].color_weight = 1.0F;
    }
  }
  internal::SurfelReport surfel_report;
  result.surfels = internal::make_surfels(voxels, options_, false, surfel_report);
  statistics.voxels_outlier = surfel_report.outliers;
  for (const std::size_t i : frames_.used) {
    result.camera_positions_m.push_back(sequence_.pose(i).translation_m());
  }
  statistics.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

}  // namespace

LiftResult start_from_cloud(const PointCloud& cloud, const RgbdSequence& sequence,
                            const LiftOptions& options, const LiftProgress& progress) {
  SEGSIM_CHECK(options.voxel_m >= 1e-3, std::to_string(options.voxel_m));
  SEGSIM_CHECK(cloud.rgb.empty() || cloud.rgb.size() == cloud.position_m.size(),
               "colours of all points or of none");
  tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
  return arena.execute([&] { return CloudStart(cloud, sequence, options, progress).run(); });
}

}  // namespace segsim::reconstruction
