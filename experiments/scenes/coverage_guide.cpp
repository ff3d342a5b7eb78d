#include "experiments/scenes/coverage_guide.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <span>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/camera.h"
#include "core/check.h"
#include "core/quantile.h"
#include "experiments/scenes/coverage.h"

namespace segsim::experiments::scenes {
namespace {

constexpr float kHole = 0.5F;  // Alpha below it.
constexpr double kVoxel_m = 0.25;
constexpr int kWidth_px = 64, kHeight_px = 48;
constexpr double kHfov_rad = std::numbers::pi / 3.0;

/// One robot view, and the voxels of its holes.
struct RobotView {
  core::Pose2 pose;
  std::vector<std::uint32_t> voxels;  ///< Ascending, each once.
};

class VoxelGrid {
 public:
  explicit VoxelGrid(const SceneBox& box) : low_m_(box.low_m), high_m_(box.high_m) {
    const glm::dvec3 size = glm::ceil((box.high_m - box.low_m) / kVoxel_m);
    count_ = glm::max(glm::ivec3(size), glm::ivec3(1));
  }

  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(count_.x) * count_.y * count_.z;
  }
  [[nodiscard]] std::uint32_t of(const glm::dvec3& p_m) const {
    const glm::ivec3 cell = glm::clamp(glm::ivec3(glm::floor((p_m - low_m_) / kVoxel_m)),
                                       glm::ivec3(0), count_ - 1);
    return static_cast<std::uint32_t>((cell.z * count_.y + cell.y) * count_.x + cell.x);
  }
  /// Where a ray from inside leaves the box, in lengths of `direction`.
  [[nodiscard]] double exit(const glm::dvec3& from_m, const glm::dvec3& direction) const {
    double least = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      if (direction[axis] == 0.0) continue;
      const double wall = direction[axis] > 0.0 ? high_m_[axis] : low_m_[axis];
      least = std::min(least, std::max((wall - from_m[axis]) / direction[axis], 0.0));
    }
    return least;
  }

 private:
  glm::dvec3 low_m_, high_m_;
  glm::ivec3 count_{1};
};

/// One centre for every square of `spacing_m` that has reachable cells: the cell nearest to
/// the mean of them.
std::vector<glm::dvec2> spread_evenly(const std::vector<glm::dvec2>& cells_m,
                                      double spacing_m) {
  std::map<std::pair<int, int>, std::vector<glm::dvec2>> squares;
  for (const glm::dvec2& p : cells_m) {
    const glm::dvec2 square = glm::floor(p / spacing_m);
    squares[{static_cast<int>(square.y), static_cast<int>(square.x)}].push_back(p);
  }
  std::vector<glm::dvec2> places_m;
  for (const auto& [square, members] : squares) {
    glm::dvec2 mean_m(0.0);
    for (const glm::dvec2& p : members) mean_m += p / static_cast<double>(members.size());
    places_m.push_back(*std::min_element(
        members.begin(), members.end(), [&](const glm::dvec2& a, const glm::dvec2& b) {
          return glm::distance(a, mean_m) < glm::distance(b, mean_m);
        }));
  }
  return places_m;
}

/// Depth of the farther surface beside each hole of a row; none where it has no neighbour.
std::vector<std::optional<double>> depths_behind(const core::Frame& frame, int y) {
  const int width = frame.alpha.width_px();
  std::vector<std::optional<double>> behind(static_cast<std::size_t>(width));
  const auto sweep = [&](int begin, int end, int step) {
    std::optional<double> last_m;
    for (int x = begin; x != end; x += step) {
      if (frame.alpha(x, y) >= kHole) {
        if (std::isfinite(frame.depth_m(x, y))) last_m = frame.depth_m(x, y);
        continue;
      }
      std::optional<double>& here = behind[static_cast<std::size_t>(x)];
      if (last_m) here = std::max(here.value_or(0.0), *last_m);
    }
  };
  sweep(0, width, 1);
  sweep(width - 1, -1, -1);
  return behind;
}

/// @return  Share of the pixels that are holes.
double find_holes(const core::Frame& frame, const VoxelGrid& grid, RobotView& view) {
  int holes = 0;
  const glm::dvec3 eye_m = frame.T_world_camera.translation_m();
  for (int y = 0; y < frame.alpha.height_px(); ++y) {
    const std::vector<std::optional<double>> behind_m = depths_behind(frame, y);
    for (int x = 0; x < frame.alpha.width_px(); ++x) {
      if (frame.alpha(x, y) >= kHole) continue;
      ++holes;
      const glm::dvec3 ray = frame.T_world_camera.rotation() *
                             frame.intrinsics.back_project({x + 0.5, y + 0.5}, 1.0);
      const double end = grid.exit(eye_m, ray);
      const double depth_m =
          std::min(behind_m[static_cast<std::size_t>(x)].value_or(end), end);
      view.voxels.push_back(grid.of(eye_m + depth_m * ray));
    }
  }
  std::sort(view.voxels.begin(), view.voxels.end());
  view.voxels.erase(std::unique(view.voxels.begin(), view.voxels.end()), view.voxels.end());
  return static_cast<double>(holes) /
         (static_cast<double>(frame.alpha.width_px()) * frame.alpha.height_px());
}

/// @param weight  Of every voxel; those that are seen become 0.
std::vector<WantedPose> wanted_poses(std::span<const RobotView> views,
                                     std::vector<double> weight, int count) {
  double total = 0.0;
  for (const double w : weight) total += w;
  std::vector<WantedPose> poses;
  while (static_cast<int>(poses.size()) < count) {
    const auto gain = [&](const RobotView& view) {
      double sum = 0.0;
      for (const std::uint32_t voxel : view.voxels) sum += weight[voxel];
      return sum;
    };
    const RobotView* best = nullptr;
    double best_gain = 0.0;
    for (const RobotView& view : views) {
      const double sum = gain(view);
      if (sum > best_gain) best = &view, best_gain = sum;
    }
    if (best == nullptr) break;
    for (const std::uint32_t voxel : best->voxels) weight[voxel] = 0.0;
    poses.push_back({best->pose, best_gain / total});
  }
  return poses;
}

}  // namespace

SceneBox scene_box(const renderer::SurfelCloud& surfels) {
  constexpr double kStray = 0.001;
  SceneBox box;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<float> values;
    values.reserve(surfels.size());
    for (const glm::vec3& p : surfels.position_m) values.push_back(p[axis]);
    box.low_m[axis] = core::quantile(values, kStray, core::Between::kLower);
    box.high_m[axis] = core::quantile(values, 1.0 - kStray, core::Between::kLower);
  }
  return box;
}

CoverageGuide coverage_guide(core::Renderer& renderer, const sim::World& world,
                             const SceneBox& box, const CoverageGuideOptions& options) {
  SEGSIM_CHECK(options.camera_height_m > 0.0 && options.spacing_m > 0.0 &&
                   options.directions > 0 && options.poses >= 0,
               "coverage guide: heights, spacing and directions are positive");
  const auto camera = core::CameraIntrinsics::from_fov(kWidth_px, kHeight_px, kHfov_rad);
  const auto T_robot_camera = core::mast_camera(options.camera_height_m, 0.0);
  const VoxelGrid grid(box);
  std::vector<double> weight(grid.size(), 0.0);
  std::vector<RobotView> views;
  CoverageGuide guide;
  guide.camera_height_m = options.camera_height_m;
  core::Frame frame;
  for (const glm::dvec2& p_m : spread_evenly(reachable_cells_m(world), options.spacing_m)) {
    CoveragePlace place{p_m, 0.0};
    for (int k = 0; k < options.directions; ++k) {
      const double yaw_rad = 2.0 * std::numbers::pi * k / options.directions;
      RobotView view{{p_m.x, p_m.y, core::wrap_angle_rad(yaw_rad)}, {}};
      renderer.render(
          core::transform_from_pose2<core::frame::World>(view.pose) * T_robot_camera, camera,
          core::Channels::kDepth, frame);
      place.missing += find_holes(frame, grid, view) / options.directions;
      for (const std::uint32_t voxel : view.voxels) weight[voxel] += 1.0;
      views.push_back(std::move(view));
    }
    guide.places.push_back(place);
  }
  for (const CoveragePlace& place : guide.places) {
    guide.missing += place.missing / static_cast<double>(guide.places.size());
  }
  guide.poses = wanted_poses(views, std::move(weight), options.poses);
  return guide;
}

}  // namespace segsim::experiments::scenes
