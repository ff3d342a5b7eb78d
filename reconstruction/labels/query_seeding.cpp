#include "reconstruction/labels/query_seeding.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/check.h"
#include "core/random.h"

namespace segsim::reconstruction {
namespace {

struct Sum {
  glm::dvec3 position_m{0.0};
  double count = 0.0;
};

/// Moves a random subset of `count` to the front.
template <class Value>
void choose(std::vector<Value>& values, std::size_t count, core::RandomStream& random) {
  for (std::size_t i = 0; i < std::min(count, values.size()); ++i) {
    const auto rest = static_cast<std::uint32_t>(values.size() - i);
    std::swap(values[i], values[i + random.index(rest)]);
  }
  values.resize(std::min(count, values.size()));
}

}  // namespace

QuerySeeder::QuerySeeder(const PanopticTrainingConfig& config, std::uint64_t seed)
    : config_(config.query), min_depth_m_(config.sampling.min_depth_m), seed_(seed) {}

void QuerySeeder::add_frame(std::int64_t frame, const core::FrameMasks& masks,
                            const core::Image<float>& depth_m,
                            const core::CameraIntrinsics& camera,
                            const core::CameraPose& T_world_camera) {
  SEGSIM_CHECK(depth_m.width_px() == masks.instance.width_px() &&
                   depth_m.height_px() == masks.instance.height_px(),
               "depth and masks of one size");
  std::map<std::uint16_t, std::vector<std::size_t>> pixels;
  for (std::size_t i = 0; i < depth_m.size(); ++i) {
    const float depth = depth_m.data()[i];
    const std::uint16_t id = masks.instance.data()[i];
    if (id == 0 || !(static_cast<double>(depth) > min_depth_m_)) continue;
    pixels[id].push_back(i);
  }
  most_masks_ = std::max(most_masks_, pixels.size());
  core::RandomStream random(seed_, "query_seeds", static_cast<std::uint64_t>(frame));
  for (auto& [id, candidates] : pixels) {
    choose(candidates, static_cast<std::size_t>(config_.seeds_per_mask), random);
    for (const std::size_t i : candidates) {
      const auto width = static_cast<std::size_t>(depth_m.width_px());
      const std::size_t row = i / width;
      const glm::dvec2 px(static_cast<double>(i % width) + 0.5,
                          static_cast<double>(row) + 0.5);
      const glm::dvec3 p_camera_m =
          camera.back_project(px, static_cast<double>(depth_m.data()[i]));
      points_.push_back(
          {T_world_camera.rotation() * p_camera_m + T_world_camera.translation_m(),
           masks.semantic.data()[i]});
    }
  }
}

std::vector<glm::vec3> QuerySeeder::seeds_m() const {
  std::map<std::array<std::int64_t, 4>, Sum> voxels;
  for (const Point& point : points_) {
    const glm::dvec3 cell = glm::floor(point.position_m / config_.seed_voxel_m);
    Sum& sum = voxels[{point.class_id, static_cast<std::int64_t>(cell.x),
                       static_cast<std::int64_t>(cell.y), static_cast<std::int64_t>(cell.z)}];
    sum.position_m += point.position_m;
    sum.count += 1.0;
  }
  std::vector<glm::vec3> seeds;
  seeds.reserve(voxels.size());
  for (const auto& [key, sum] : voxels) seeds.emplace_back(sum.position_m / sum.count);
  const auto most = static_cast<std::size_t>(config_.max_queries);
  core::RandomStream random(seed_, "query_subset");
  if (seeds.size() > most) choose(seeds, most, random);
  const auto least =
      std::min(most, static_cast<std::size_t>(std::ceil(config_.min_queries_per_mask *
                                                        static_cast<double>(most_masks_))));
  while (seeds.size() < least && !points_.empty()) {
    seeds.emplace_back(
        points_[random.index(static_cast<std::uint32_t>(points_.size()))].position_m);
  }
  return seeds;
}

}  // namespace segsim::reconstruction
