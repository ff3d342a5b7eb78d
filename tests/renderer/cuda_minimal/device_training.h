#pragma once

/// @file
/// Parameters, images and gradients of training_surfels.h in device memory.

#include <cstdint>
#include <span>
#include <vector>

#include "renderer/cuda/device_memory.h"
#include "tests/reconstruction/training/training_surfels.h"

namespace segsim::renderer::testing {

template <class T>
cuda::DeviceArray<T> uploaded(const std::vector<T>& values) {
  return cuda::DeviceArray<T>(std::span<const T>(values));
}

template <class T>
std::vector<T> downloaded(const T* device, std::size_t count) {
  std::vector<T> values(count);
  if (count == 0) return values;
  cuda::throw_on_error(
      cudaMemcpy(values.data(), device, count * sizeof(T), cudaMemcpyDeviceToHost),
      "cudaMemcpy");
  return values;
}

/// Of bytes 0xA5, so that a test sees what no one wrote.
inline cuda::DeviceArray<float> poisoned(std::size_t count) {
  cuda::DeviceArray<float> array(count);
  if (count > 0) {
    cuda::throw_on_error(cudaMemset(array.data(), 0xA5, array.bytes()), "cudaMemset");
  }
  return array;
}

struct DeviceSurfels {
  explicit DeviceSurfels(const reconstruction::testing::OwnedSurfels<float>& s)
      : sh_degree(s.sh_degree),
        active_sh_degree(s.active_sh_degree),
        count(s.count()),
        position_m(uploaded(s.position_m)),
        log_scale(uploaded(s.log_scale)),
        rotation(uploaded(s.rotation)),
        opacity_logit(uploaded(s.opacity_logit)),
        sh(uploaded(s.sh)) {}
  [[nodiscard]] reconstruction::SurfelParameters<float> view() const {
    return {count,
            sh_degree,
            active_sh_degree,
            position_m.data(),
            log_scale.data(),
            rotation.data(),
            opacity_logit.data(),
            sh.data()};
  }

  int sh_degree, active_sh_degree;
  std::int64_t count;
  cuda::DeviceArray<float> position_m, log_scale, rotation, opacity_logit, sh;
};

struct DeviceGradients {
  explicit DeviceGradients(const DeviceSurfels& s)
      : position_m(poisoned(s.position_m.size())),
        log_scale(poisoned(s.log_scale.size())),
        rotation(poisoned(s.rotation.size())),
        opacity_logit(poisoned(s.opacity_logit.size())),
        sh(poisoned(s.sh.size())),
        screen(poisoned(s.opacity_logit.size())),
        max_weight(poisoned(s.opacity_logit.size())) {}
  [[nodiscard]] reconstruction::SurfelGradients<float> view() const {
    return {position_m.data(), log_scale.data(), rotation.data(),  opacity_logit.data(),
            sh.data(),         screen.data(),    max_weight.data()};
  }
  void download(reconstruction::testing::OwnedGradients<float>& to) const {
    to.position_m = downloaded(position_m.data(), position_m.size());
    to.log_scale = downloaded(log_scale.data(), log_scale.size());
    to.rotation = downloaded(rotation.data(), rotation.size());
    to.opacity_logit = downloaded(opacity_logit.data(), opacity_logit.size());
    to.sh = downloaded(sh.data(), sh.size());
    to.screen = downloaded(screen.data(), screen.size());
  }

  cuda::DeviceArray<float> position_m, log_scale, rotation, opacity_logit, sh, screen,
      max_weight;
};

struct DeviceTrainingImages {
  explicit DeviceTrainingImages(const core::CameraIntrinsics& c)
      : width_px(c.width_px),
        height_px(c.height_px),
        rgb(poisoned(3 * area())),
        depth_m(poisoned(area())),
        alpha(poisoned(area())),
        normal(poisoned(3 * area())),
        median_m(poisoned(area())),
        distortion(poisoned(area())) {}
  explicit DeviceTrainingImages(const reconstruction::testing::OwnedImages<float>& images)
      : width_px(images.width_px),
        height_px(images.height_px),
        rgb(uploaded(images.rgb)),
        depth_m(uploaded(images.depth_m)),
        alpha(uploaded(images.alpha)),
        normal(uploaded(images.normal)),
        median_m(uploaded(images.median_m)),
        distortion(uploaded(images.distortion)) {}
  [[nodiscard]] std::size_t area() const {
    return static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
  }
  template <class Value = float>
  [[nodiscard]] reconstruction::TrainingImages<Value> view() const {
    return {width_px,     height_px,     rgb.data(),      depth_m.data(),
            alpha.data(), normal.data(), median_m.data(), distortion.data()};
  }
  void download(reconstruction::testing::OwnedImages<float>& to) const {
    to.rgb = downloaded(rgb.data(), rgb.size());
    to.depth_m = downloaded(depth_m.data(), depth_m.size());
    to.alpha = downloaded(alpha.data(), alpha.size());
    to.normal = downloaded(normal.data(), normal.size());
    to.median_m = downloaded(median_m.data(), median_m.size());
    to.distortion = downloaded(distortion.data(), distortion.size());
  }

  int width_px, height_px;
  cuda::DeviceArray<float> rgb, depth_m, alpha, normal, median_m, distortion;
};

}  // namespace segsim::renderer::testing
