#include "reconstruction/training/pose_alignment.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/check.h"
#include "reconstruction/training/internal/surfel_state.h"
#include "reconstruction/training/internal/training_poses.h"
#include "reconstruction/training/internal/view_loss.h"

namespace segsim::reconstruction {
namespace {

constexpr double kFinalRate = 0.05;  ///< Of the first: the way ends in small steps.

}  // namespace

std::vector<core::CameraPose> align_views(
    const std::vector<TrainingView>& views, const core::CameraIntrinsics& intrinsics,
    const renderer::SurfelCloud& surfels, const GeometryConfig& config,
    const GeometryDevice& device,
    const std::function<void(std::int64_t done, std::int64_t total)>& progress) {
  internal::RasterFunction raster(
      make_training_rasterizer(device),
      trains_on_gpu(device) ? at::Device(torch::kCUDA, 0) : at::Device(torch::kCPU));
  const internal::SurfelState state(surfels, surfels.sh_degree, raster.device());
  // Pictures alone: the surfels' mean depth is not quite the sensor's, and a pose would give
  // way to the difference.
  GeometryConfig::Loss weight = config.loss;
  weight.depth = weight.normal = 0.0;
  const auto or_else = [](double rate, double other) { return rate > 0.0 ? rate : other; };
  const double rate_m = or_else(config.rate.pose_translation, kAlignmentRate_m);
  const double rate_rad = or_else(config.rate.pose_rotation, kAlignmentRate_rad);

  std::vector<core::CameraPose> aligned;
  for (const TrainingView& view : views) {
    const internal::ViewTargets targets = internal::view_targets(view, raster.device());
    internal::TrainingPoses pose({view.T_world_camera});
    core::CameraPose best = view.T_world_camera;
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i <= kAlignmentSteps; ++i) {
      const core::CameraPose now = pose.now()[0];
      const internal::SurfelTensors leaves = state.leaves();
      const internal::ViewTensors drawn =
          raster.draw(leaves, surfels.sh_degree, intrinsics, now, false);
      GeometryStep losses;
      const internal::Tensor loss =
          internal::view_loss(drawn, targets, weight, {}, {}, now, losses);
      if (losses.total() < least) least = losses.total(), best = now;
      if (i == kAlignmentSteps || !std::isfinite(losses.total())) break;
      loss.backward();
      const double factor = std::pow(kFinalRate, static_cast<double>(i) / kAlignmentSteps);
      pose.step(0, internal::camera_gradient(leaves, internal::gradients_of(leaves), now),
                factor * rate_m, factor * rate_rad);
    }
    aligned.push_back(best);
    if (progress) {
      progress(static_cast<std::int64_t>(aligned.size()),
               static_cast<std::int64_t>(views.size()));
    }
  }
  return aligned;
}

PoseChange pose_change(std::span<const core::CameraPose> from,
                       std::span<const core::CameraPose> to) {
  SEGSIM_CHECK(!from.empty() && from.size() == to.size(), std::to_string(to.size()));
  PoseChange change;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const auto T_to_from = to[i].inverse() * from[i];
    const glm::dvec3 d_m = to[i].translation_m() - from[i].translation_m();
    const double way_m = std::sqrt(d_m.x * d_m.x + d_m.y * d_m.y + d_m.z * d_m.z);
    const glm::dquat& q = T_to_from.rotation();
    const double turn_rad =
        2.0 * std::atan2(std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z), std::abs(q.w));
    change.mean_m += way_m / static_cast<double>(from.size());
    change.mean_rad += turn_rad / static_cast<double>(from.size());
    change.largest_m = std::max(change.largest_m, way_m);
    change.largest_rad = std::max(change.largest_rad, turn_rad);
  }
  return change;
}

}  // namespace segsim::reconstruction
