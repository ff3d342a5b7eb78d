#include "reconstruction/training/internal/geometry_losses.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include <ATen/Parallel.h>
#include <glm/gtc/quaternion.hpp>

#include "core/check.h"
#include "core/process/vector_clones.h"

namespace segsim::reconstruction::internal {
namespace {

using torch::indexing::Slice;

constexpr std::int64_t kRadius_px = 5;
constexpr double kSigma_px = 1.5;
constexpr double kC1 = 0.01 * 0.01, kC2 = 0.03 * 0.03;
constexpr double kMinAlpha = 0.5, kSmallAlpha = 1e-3;

using Window = std::array<float, 2 * kRadius_px + 1>;

Window make_window() {
  std::array<double, 2 * kRadius_px + 1> exact{};
  double sum = 0.0;
  for (int k = 0; k < static_cast<int>(exact.size()); ++k) {
    const double x = static_cast<double>(k - kRadius_px) / kSigma_px;
    sum += exact[static_cast<std::size_t>(k)] = std::exp(-0.5 * x * x);
  }
  Window window{};
  for (std::size_t k = 0; k < exact.size(); ++k) {
    window[k] = static_cast<float>(exact[k] / sum);
  }
  return window;
}

/// Eight sums that stay in a register: left alone, the compiler takes two taps at a time and
/// adds lane by lane.
using Lanes = float __attribute__((vector_size(32)));
constexpr std::int64_t kLanes = 8;

/// out[i] = sum_k weights[k] taps[k][i], added up in the order of k.
SEGSIM_VECTOR_CLONES
void weighted_sum(std::span<const float* const> taps, const float* weights, std::int64_t size,
                  float* out) {
  std::int64_t i = 0;
  for (; i + kLanes <= size; i += kLanes) {
    Lanes sum{};
    for (std::size_t k = 0; k < taps.size(); ++k) {
      Lanes from;
      std::memcpy(&from, taps[k] + i, sizeof from);
      sum += weights[k] * from;
    }
    std::memcpy(out + i, &sum, sizeof sum);
  }
  for (; i < size; ++i) {
    out[i] = 0.0F;
    for (std::size_t k = 0; k < taps.size(); ++k) out[i] += weights[k] * taps[k][i];
  }
}

Tensor blur_on_cpu(const Tensor& image) {
  static const Window window = make_window();
  using Taps = std::array<const float*, std::tuple_size_v<Window>>;
  const Tensor in = image.contiguous();
  const std::int64_t height = in.size(0), channels = in.size(2);
  const std::int64_t row = in.size(1) * channels;
  Tensor across = torch::empty_like(in), out = torch::empty_like(in);
  const auto* from = in.data_ptr<float>();
  auto* middle = across.data_ptr<float>();
  auto* to = out.data_ptr<float>();
  at::parallel_for(0, height, 8, [&](std::int64_t begin, std::int64_t end) {
    const std::int64_t margin = kRadius_px * channels;
    std::vector<float> padded(static_cast<std::size_t>(row + 2 * margin), 0.0F);
    Taps taps{};
    for (std::size_t k = 0; k < taps.size(); ++k) {
      taps[k] = padded.data() + static_cast<std::int64_t>(k) * channels;
    }
    for (std::int64_t y = begin; y < end; ++y) {
      std::copy(from + y * row, from + (y + 1) * row, padded.begin() + margin);
      weighted_sum(taps, window.data(), row, middle + y * row);
    }
  });
  at::parallel_for(0, height, 8, [&](std::int64_t begin, std::int64_t end) {
    Taps taps{};
    for (std::int64_t y = begin; y < end; ++y) {
      const std::int64_t first = std::max<std::int64_t>(y - kRadius_px, 0);
      const std::int64_t last = std::min(y + kRadius_px, height - 1);
      const auto count = static_cast<std::size_t>(last - first + 1);
      for (std::size_t k = 0; k < count; ++k) {
        taps[k] = middle + (first + static_cast<std::int64_t>(k)) * row;
      }
      weighted_sum({taps.data(), count}, window.data() + (first - y + kRadius_px), row,
                   to + y * row);
    }
  });
  return out;
}

/// Any device and type: a convolution along each axis.
Tensor blur_anywhere(const Tensor& image) {
  const Window window = make_window();
  const Tensor weights = device_tensor(std::vector<float>(window.begin(), window.end()),
                                       torch::kFloat32, image.device())
                             .to(image.scalar_type());
  const Tensor planes = image.permute({2, 0, 1}).unsqueeze(1);
  const Tensor across = at::conv2d(planes, weights.view({1, 1, 1, -1}), Tensor(), {1, 1},
                                   at::IntArrayRef({0, kRadius_px}));
  const Tensor both = at::conv2d(across, weights.view({1, 1, -1, 1}), Tensor(), {1, 1},
                                 at::IntArrayRef({kRadius_px, 0}));
  return both.squeeze(1).permute({1, 2, 0}).contiguous();
}

Tensor blur(const Tensor& image) {
  const bool fast = image.is_cpu() && image.scalar_type() == torch::kFloat32;
  return fast ? blur_on_cpu(image) : blur_anywhere(image);
}

/// The window is symmetric, so the blur is its own adjoint.
struct Blur : torch::autograd::Function<Blur> {
  static Tensor forward(torch::autograd::AutogradContext*, const Tensor& image) {
    return blur(image);
  }
  static torch::autograd::variable_list backward(
      torch::autograd::AutogradContext*, const torch::autograd::variable_list& by_output) {
    return {blur(by_output[0])};
  }
};

Tensor rotation_matrix(const core::CameraPose& T_world_camera, const Tensor& like) {
  std::vector<double> values;  // Row-major R^T: rows of pixels are multiplied from the left.
  for (int axis = 0; axis < 3; ++axis) {
    glm::dvec3 unit(0.0);
    unit[axis] = 1.0;
    const glm::dvec3 column = T_world_camera.rotation() * unit;
    values.insert(values.end(), {column.x, column.y, column.z});
  }
  return device_tensor(values, torch::kFloat64, like.device())
      .to(like.scalar_type())
      .view({3, 3});
}

}  // namespace

Tensor ssim_blur(const Tensor& image) {
  SEGSIM_CHECK(image.dim() == 3, "an image of " + std::to_string(image.dim()) + " dimensions");
  return Blur::apply(image);
}

Tensor ssim(const Tensor& image, const Tensor& truth) {
  SEGSIM_CHECK(image.sizes() == truth.sizes(), "images of different sizes");
  const auto of_image =
      ssim_blur(at::cat({image, image * image, image * truth}, 2)).chunk(3, 2);
  const auto of_truth = ssim_blur(at::cat({truth, truth * truth}, 2)).chunk(2, 2);
  const Tensor &mean_x = of_image[0], &mean_y = of_truth[0];
  const Tensor mean_xy = mean_x * mean_y;
  const Tensor squares = mean_x * mean_x + mean_y * mean_y;
  const Tensor variances = of_image[1] + of_truth[1] - squares;
  const Tensor covariance = of_image[2] - mean_xy;
  const Tensor map =
      (2.0 * mean_xy + kC1) * (2.0 * covariance + kC2) / ((squares + kC1) * (variances + kC2));
  return map.mean();
}

Tensor photometric_loss(const Tensor& rgb, const Tensor& truth, const Tensor& valid,
                        double ssim_share) {
  Tensor target = truth;
  if (valid.defined()) target = torch::where(valid.unsqueeze(2), truth, rgb.detach());
  Tensor loss = (1.0 - ssim_share) * (rgb - target).abs().mean();
  if (ssim_share > 0.0) loss = loss + ssim_share * (1.0 - ssim(rgb, target));
  return loss;
}

Tensor expected_depth(const Tensor& depth_sum_m, const Tensor& alpha) {
  return depth_sum_m / alpha.clamp_min(kSmallAlpha);
}

Tensor depth_loss(const Tensor& depth_sum_m, const Tensor& alpha, const Tensor& sensor_m,
                  const Tensor& weight, double min_m, double max_m) {
  // Comparisons with NaN are false.
  const Tensor counts = sensor_m.gt(min_m) & sensor_m.lt(max_m) & alpha.detach().gt(kMinAlpha);
  const Tensor error = (expected_depth(depth_sum_m, alpha) - sensor_m.nan_to_num(0.0)).abs();
  if (weight.defined()) {
    const Tensor weights = torch::where(counts, weight, torch::zeros_like(weight));
    return (weights * error).sum() / weights.sum().clamp_min(1e-6);
  }
  const Tensor sum = torch::where(counts, error, torch::zeros_like(error)).sum();
  return sum / counts.sum().clamp_min(1).to(error.scalar_type());
}

Tensor plane_loss(const Tensor& normal, const Tensor& depth_sum_m, const Tensor& alpha,
                  const Tensor& sensor_m, const Tensor& rays,
                  const core::CameraPose& T_world_camera, const GeometryConfig::Loss& config) {
  const Tensor counts = sensor_m.gt(config.min_depth_m) & sensor_m.lt(config.max_depth_m) &
                        alpha.detach().gt(kMinAlpha);
  const Tensor error = expected_depth(depth_sum_m, alpha) - sensor_m.nan_to_num(0.0);
  const Tensor world_rays = at::matmul(rays, rotation_matrix(T_world_camera, rays));
  const Tensor unit = normal / normal.square().sum(2, true).add(1e-12).sqrt();
  const Tensor distance = (error * (unit * world_rays).sum(2)).abs();
  const Tensor cost = distance.clamp_max(config.plane_truncation_m);
  const Tensor sum = torch::where(counts, cost, torch::zeros_like(cost)).sum();
  return sum / counts.sum().clamp_min(1).to(cost.scalar_type());
}

Tensor camera_rays(const core::CameraIntrinsics& camera, const at::Device& device) {
  std::vector<double> values;
  values.reserve(3UL * static_cast<std::size_t>(camera.width_px) *
                 static_cast<std::size_t>(camera.height_px));
  for (int y = 0; y < camera.height_px; ++y) {
    for (int x = 0; x < camera.width_px; ++x) {
      const glm::dvec3 ray = camera.back_project({x + 0.5, y + 0.5}, 1.0);
      values.insert(values.end(), {ray.x, ray.y, ray.z});
    }
  }
  return device_tensor(values, torch::kFloat64, torch::kCPU)
      .to(torch::kFloat32)
      .view({camera.height_px, camera.width_px, 3})
      .to(device);
}

Tensor normal_consistency(const Tensor& normal, const Tensor& depth_sum_m, const Tensor& alpha,
                          const Tensor& rays, const core::CameraPose& T_world_camera) {
  const Tensor points = rays * expected_depth(depth_sum_m, alpha).unsqueeze(2);
  using torch::indexing::None;
  const Slice inner(1, -1), before(None, -2), after(2, None);
  const Tensor along_x = points.index({inner, after}) - points.index({inner, before});
  const Tensor along_y = points.index({after, inner}) - points.index({before, inner});
  // y before x: towards the camera.
  const Tensor cross = at::linalg_cross(along_y, along_x, 2);
  const Tensor length = cross.square().sum(2, true).add(1e-20).sqrt();
  const Tensor depth_normal =
      at::matmul(cross / length, rotation_matrix(T_world_camera, cross));
  const Tensor inner_alpha = alpha.index({inner, inner}).detach();
  const Tensor error = inner_alpha - (normal.index({inner, inner}) * depth_normal).sum(2);
  const Tensor counts = inner_alpha.gt(kMinAlpha);
  return torch::where(counts, error, torch::zeros_like(error)).mean();
}

}  // namespace segsim::reconstruction::internal
