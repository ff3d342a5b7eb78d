#pragma once

/// @file
/// Rendered images in the encodings of Gazebo's sensors (gz-sensors, gz-rendering):
///
///     colour        RGB_INT8, 3 bytes a pixel
///     depth         R_FLOAT32, metres along the optical axis; +inf where nothing is or it is
///                   beyond the far plane, -inf nearer than the near plane (REP 117)
///     labels map    RGB_INT8, see GazeboLabels; the background is 0, 0, 0
///     coloured map  RGB_INT8, a colour for each pair of label and count
///
/// Rows lie without padding, little-endian.

#include <cstdint>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "sim/gazebo/gazebo_cameras.h"

namespace segsim::sim {

/// Fills `bytes`, whose allocation is reused.
void encode_rgb(const core::Image<core::Rgb8>& rgb, std::string& bytes);
void encode_depth(const core::Image<float>& depth_m, double near_m, double far_m,
                  std::string& bytes);

/// Classes and instances of one scene as Gazebo's labels and counts.
class GazeboLabelEncoder {
 public:
  /// @throws core::InputError for a class id above 255, which no labels map can tell.
  explicit GazeboLabelEncoder(const core::SceneManifest& scene);

  /// Count of an instance among those of its class, from 1, by ascending id. Pixels of a
  /// class without an instance count as 1: Gazebo numbers whatever has a label.
  [[nodiscard]] std::uint16_t count_of(std::uint16_t instance_id) const {
    return counts_[instance_id];
  }
  void encode_labels(const core::Frame& frame, GazeboLabels coding, std::string& bytes) const;
  void encode_colors(const core::Frame& frame, GazeboLabels coding, std::string& bytes) const;

 private:
  std::vector<std::uint16_t> counts_;  ///< For every instance id.
};

}  // namespace segsim::sim
