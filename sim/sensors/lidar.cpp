#include "sim/sensors/lidar.h"

#include <cmath>
#include <limits>

#include "core/check.h"
#include "sim/sensors/pixel_noise.h"

namespace segsim::sim {

std::shared_ptr<const RayScene> make_ray_scene(const TriangleMesh& mesh) {
  MeshScene scene;
  SubMesh& part = scene.meshes.emplace_back();
  part.positions_m = mesh.positions_m;
  part.triangles = mesh.triangles;
  return std::make_shared<const RayScene>(scene);
}

std::vector<float> scan(const LidarModel& model, const RayScene& scene, const PoseAt& pose_at,
                        core::TimeNs start_ns, std::uint64_t seed, std::uint64_t index) {
  SEGSIM_CHECK(model.beams > 1 && model.last_rad > model.first_rad, "beams");
  std::vector<float> ranges_m(static_cast<std::size_t>(model.beams),
                              std::numeric_limits<float>::quiet_NaN());
  std::vector<float> noise(ranges_m.size());
  PixelNoise(seed, "lidar", index).fill_normal(0, 0, noise);
  const auto low = static_cast<float>(model.min_range_m);
  const auto high = static_cast<float>(model.max_range_m);
  core::Pose2 pose = pose_at(start_ns);
  for (int beam = 0; beam < model.beams; ++beam) {
    if (model.sweep_s > 0.0) {
      pose = pose_at(start_ns + model.sweep_ns() * beam / (model.beams - 1));
    }
    const double angle = pose.yaw_rad + model.angle_rad(beam);
    const glm::vec3 origin_m(pose.x_m + model.forward_m * std::cos(pose.yaw_rad),
                             pose.y_m + model.forward_m * std::sin(pose.yaw_rad),
                             model.height_m);
    const glm::vec3 direction(std::cos(angle), std::sin(angle), 0.0);
    const RayHit hit = scene.cast(origin_m, direction, 0.0F, high);
    if (!hit.hit()) continue;
    const auto k = static_cast<std::size_t>(beam);
    const float range_m = hit.t + static_cast<float>(model.sigma_m) * noise[k];
    if (range_m >= low && range_m <= high) ranges_m[k] = range_m;
  }
  return ranges_m;
}

}  // namespace segsim::sim
