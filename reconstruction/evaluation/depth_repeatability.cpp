#include "reconstruction/evaluation/depth_repeatability.h"

#include <cmath>
#include <limits>

namespace segsim::reconstruction {

core::Image<float> reprojected_depth(const core::Image<float>& depth_m,
                                     const core::CameraIntrinsics& intrinsics,
                                     const core::CameraPose& T_world_a,
                                     const core::CameraPose& T_world_b) {
  constexpr double kNearest_m = 1e-3;  // Behind it a projection is meaningless.
  core::Image<float> at_b(depth_m.width_px(), depth_m.height_px(),
                          std::numeric_limits<float>::quiet_NaN());
  const auto T_b_a = T_world_b.inverse() * T_world_a;
  for (int y = 0; y < depth_m.height_px(); ++y) {
    for (int x = 0; x < depth_m.width_px(); ++x) {
      const float z_a_m = depth_m(x, y);
      if (!(z_a_m > 0.0F) || !std::isfinite(z_a_m)) continue;
      const glm::dvec3 p_a_m = intrinsics.back_project({x + 0.5, y + 0.5}, z_a_m);
      const glm::dvec3 p_b_m = (T_b_a * core::Point<core::frame::Camera>{p_a_m}).xyz_m;
      if (p_b_m.z < kNearest_m) continue;
      const glm::dvec2 px = intrinsics.project(p_b_m);
      if (!(px.x >= 0.0 && px.y >= 0.0 && px.x < at_b.width_px() && px.y < at_b.height_px())) {
        continue;
      }
      float& z_b_m = at_b(static_cast<int>(px.x), static_cast<int>(px.y));
      if (std::isnan(z_b_m) || p_b_m.z < z_b_m) z_b_m = static_cast<float>(p_b_m.z);
    }
  }
  return at_b;
}

}  // namespace segsim::reconstruction
