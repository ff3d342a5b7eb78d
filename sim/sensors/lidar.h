#pragma once

/// @file
/// A planar laser scanner: Embree rays against the mesh of the scene.
///
/// Beam i of n looks at angle first + i (last - first) / (n - 1) about the sensor's z axis,
/// 0 = the robot's +x, counter-clockwise. Defaults: Jackal's Hokuyo UST-10
/// (jackal_description, hokuyo_ust10.urdf.xacro): 720 beams over +-2.35619 rad, 0.1 m to 30 m,
/// 50 Hz, sigma 1 mm. Where it is mounted is our choice.

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "core/frames.h"
#include "core/stages.h"
#include "sim/ground/ray_scene.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::sim {

struct LidarModel {
  int beams = 720;
  double first_rad = -2.35619, last_rad = 2.35619;
  double min_range_m = 0.1, max_range_m = 30.0;
  double sigma_m = 0.001;
  double height_m = 0.30, forward_m = 0.12;  ///< Of the rays' origin, in the robot's frame.
  /// The mirror turns while the robot moves: the last beam is so much later than the first.
  /// 0: all at once.
  double sweep_s = 0.0;

  [[nodiscard]] double angle_rad(int beam) const {
    return first_rad + (last_rad - first_rad) * beam / (beams - 1);
  }
  [[nodiscard]] core::TimeNs sweep_ns() const { return std::llround(sweep_s * 1e9); }
};

/// Rays against a plain mesh, for any number of trials side by side.
[[nodiscard]] std::shared_ptr<const RayScene> make_ray_scene(const TriangleMesh& mesh);

/// True pose at a time of the sweep.
using PoseAt = std::function<core::Pose2(core::TimeNs)>;

/// One scan that begins at `start_ns`.
/// @param seed, index  Of the episode and of the scan: they name its noise.
/// @return  [beams] ranges; NaN where nothing is, or out of range.
[[nodiscard]] std::vector<float> scan(const LidarModel& model, const RayScene& scene,
                                      const PoseAt& pose_at, core::TimeNs start_ns,
                                      std::uint64_t seed, std::uint64_t index);

}  // namespace segsim::sim
