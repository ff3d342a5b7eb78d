#pragma once

/// @file
/// A scene in device memory.

#include <cstdint>
#include <vector>

#include "renderer/cuda/device_data.h"
#include "renderer/cuda/device_memory.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer::cuda {

class DeviceScene {
 public:
  /// @param field  May be null.
  DeviceScene(const SurfelCloud& cloud, const PanopticField* field);

  [[nodiscard]] const SceneView& view() const { return view_; }
  [[nodiscard]] const PanopticView& field() const { return field_; }
  [[nodiscard]] const FeatureView& features() const { return features_; }
  [[nodiscard]] std::size_t padded_surfels() const {
    return static_cast<std::size_t>(view_.clusters) * kClusterSurfels;
  }

 private:
  void upload_field(const PanopticField& field);
  PanopticRows upload_rows(const SparseScores& scores);
  void upload_features(const SurfelCloud& cloud);
  const float* keep(const std::vector<float>& values);

  std::vector<DeviceArray<float>> floats_;
  DeviceArray<std::uint32_t> id_, place_, label_;
  std::vector<DeviceArray<std::uint16_t>> indices_;
  DeviceArray<PanopticHead> head_;
  DeviceArray<std::uint8_t> class_is_thing_;
  SceneView view_{};
  PanopticView field_{};
  FeatureView features_{};
};

}  // namespace segsim::renderer::cuda
