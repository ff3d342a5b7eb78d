#pragma once

/// @file
/// Where queries begin: points of the masks, thinned (PanopticRecon++; one grid per class is
/// this project's, so that a table's seed does not absorb the monitor on it).

#include <cstdint>
#include <map>
#include <vector>

#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/frame_masks.h"
#include "core/frames.h"
#include "reconstruction/labels/panoptic_config.h"

namespace segsim::reconstruction {

class QuerySeeder {
 public:
  QuerySeeder(const PanopticTrainingConfig& config, std::uint64_t seed);

  /// Draws pixels with depth from every mask of a frame.
  /// @param frame  Names the random numbers: the same for equal frames.
  /// @param depth_m  Of the masks' size; NaN = unknown.
  void add_frame(std::int64_t frame, const core::FrameMasks& masks,
                 const core::Image<float>& depth_m, const core::CameraIntrinsics& camera,
                 const core::CameraPose& T_world_camera);

  /// One seed for every occupied voxel and class, the mean of its points; a random subset
  /// beyond max_queries. If that is less than min_queries_per_mask times the masks of the
  /// fullest frame, random points are added.
  [[nodiscard]] std::vector<glm::vec3> seeds_m() const;

 private:
  struct Point {
    glm::dvec3 position_m;
    std::uint16_t class_id;
  };
  QueryConfig config_;
  double min_depth_m_;
  std::uint64_t seed_;
  std::vector<Point> points_;
  std::size_t most_masks_ = 0;
};

}  // namespace segsim::reconstruction
