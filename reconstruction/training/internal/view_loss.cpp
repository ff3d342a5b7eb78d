#include "reconstruction/training/internal/view_loss.h"

#include <vector>

#include "reconstruction/training/internal/geometry_losses.h"

namespace segsim::reconstruction::internal {

ViewTargets view_targets(const TrainingView& view, const at::Device& device) {
  const std::int64_t height = view.rgb.height_px(), width = view.rgb.width_px();
  // from_blob() only reads here; it has no variant for const memory.
  const auto borrow = [&](const void* data, std::vector<std::int64_t> shape,
                          at::ScalarType type) {
    return torch::from_blob(const_cast<void*>(data), shape, torch::TensorOptions().dtype(type))
        .to(device);
  };
  ViewTargets targets;
  targets.rgb =
      borrow(view.rgb.data(), {height, width, 3}, torch::kUInt8).to(torch::kFloat32) / 255.0F;
  if (!view.depth_m.empty()) {
    targets.depth_m = borrow(view.depth_m.data(), {height, width}, torch::kFloat32);
  }
  if (!view.depth_m.empty() && view.sensor != DepthSensor::kUnstated) {
    std::vector<float> weight(view.depth_m.size(), 1.0F);
    for (std::size_t i = 0; i < weight.size(); ++i) {
      const float z = view.depth_m.data()[i];
      if (z > 0.0F) weight[i] = depth_weight(view.sensor, z);
    }
    targets.depth_weight =
        device_tensor(weight, torch::kFloat32, device).view({height, width});
  }
  if (!view.valid.empty()) {
    targets.valid = borrow(view.valid.data(), {height, width}, torch::kUInt8).ne(0);
  }
  return targets;
}

Tensor view_loss(const ViewTensors& drawn, const ViewTargets& targets,
                 const GeometryConfig::Loss& weight, const Tensor& exposure,
                 const Tensor& rays, const core::CameraPose& T_world_camera,
                 GeometryStep& step) {
  Tensor rgb = drawn.rgb;
  if (exposure.defined()) rgb = rgb * exposure.select(0, 0).exp() + exposure.select(0, 1);
  Tensor total = photometric_loss(rgb, targets.rgb, targets.valid, weight.ssim);
  step.color = total.item<double>();
  const auto add = [&](double factor, const Tensor& loss, double& value) {
    const Tensor scaled = factor * loss;
    value = scaled.item<double>();
    total = total + scaled;
  };
  if (weight.depth > 0.0 && targets.depth_m.defined()) {
    add(weight.depth,
        depth_loss(drawn.depth_m, drawn.alpha, targets.depth_m, targets.depth_weight,
                   weight.min_depth_m, weight.max_depth_m),
        step.depth);
  }
  if (weight.plane > 0.0 && targets.depth_m.defined() && rays.defined()) {
    add(weight.plane,
        plane_loss(drawn.normal, drawn.depth_m, drawn.alpha, targets.depth_m, rays,
                   T_world_camera, weight),
        step.plane);
  }
  if (weight.normal > 0.0 && rays.defined()) {
    add(weight.normal,
        normal_consistency(drawn.normal, drawn.depth_m, drawn.alpha, rays, T_world_camera),
        step.normal);
  }
  if (drawn.distortion.defined()) {
    add(weight.distortion, drawn.distortion.mean(), step.distortion);
  }
  return total;
}

SurfelTensors gradients_of(const SurfelTensors& leaves) {
  return {leaves.position_m.grad(), leaves.log_scale.grad(), leaves.rotation.grad(),
          leaves.opacity_logit.grad(), leaves.sh.grad()};
}

}  // namespace segsim::reconstruction::internal
