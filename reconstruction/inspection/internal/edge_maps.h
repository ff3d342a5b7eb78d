#pragma once

/// @file
/// Edges of pictures by their direction, and contours of depth.

#include <array>
#include <cstdint>
#include <vector>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <opencv2/core.hpp>

#include "core/camera.h"
#include "core/image.h"

namespace segsim::reconstruction::internal {

/// The strongest tenth of the gradients are edges, whatever the contrast.
struct ColorEdges {
  cv::Mat edges;   ///< 8 bit, not 0 on an edge.
  cv::Mat dx, dy;  ///< Gradient, float.
};
[[nodiscard]] ColorEdges find_color_edges(const cv::Mat& grey);

/// Distances to the next edge in colour, apart for edges of different directions: a contour is
/// looked for among edges that run as it does.
class DirectedEdges {
 public:
  static constexpr int kDirections = 4;
  static constexpr double kFarthest_px = 15.0;

  explicit DirectedEdges(const cv::Mat& grey);

  [[nodiscard]] int width_px() const { return distance_[0].width_px(); }
  [[nodiscard]] int height_px() const { return distance_[0].height_px(); }

  struct Sample {
    float distance_px = -1.0F;  ///< At most kFarthest_px; < 0: outside of the picture.
    glm::vec2 gradient{0.0F};
  };
  /// Between four pixels.
  [[nodiscard]] Sample at(int direction, const glm::dvec2& px) const;

  /// Of an edge with this gradient.
  [[nodiscard]] static int direction_of(double dx, double dy);

 private:
  std::array<core::Image<std::uint8_t>, kDirections> distance_;  ///< In 1/16 px.
};

/// A place where a near surface ends and a farther one begins.
struct ContourPoint {
  glm::vec3 p_camera_m;  ///< On the near surface, in the frame of the depth camera.
  int direction = 0;     ///< DirectedEdges::direction_of() across it.
};

/// Steps of more than 8 % between measurements that are neighbours but for a few pixels
/// without.
/// @param camera  Of the depth image.
[[nodiscard]] std::vector<ContourPoint> find_contours(const core::Image<float>& depth_m,
                                                      const core::CameraIntrinsics& camera);

}  // namespace segsim::reconstruction::internal
