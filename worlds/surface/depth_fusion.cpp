#include "worlds/surface/depth_fusion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/task_order.h"
#include "worlds/surface/internal/distance_volume.h"

namespace segsim::worlds {
namespace {

using internal::kBlockSide;
using internal::kBlockVoxels;
using internal::PlaceKey;
using internal::VoxelBlock;

/// Blocks far outside fit no key, and no building.
constexpr double kLargestPlace_m = 10000.0;
/// Depths of neighbours that differ by more than this share of the depth are an edge.
constexpr float kEdgeShare = 0.05F;

/// A view with everything in camera coordinates.
struct PreparedView {
  core::CameraIntrinsics camera;
  glm::dmat3 R_world_camera{1.0};
  glm::dvec3 p_world_camera_m{0.0};
  core::Image<float> depth_m;     ///< 0 = not used.
  core::Image<glm::vec3> normal;  ///< Camera frame, towards the camera.
  core::Image<float> cosine;      ///< Of normal and line of sight.
};

/// Calls body(i) for each i < count; the body writes to places of its own.
template <class Body>
void for_each(tbb::task_arena& arena, std::size_t count, std::size_t grain, const Body& body) {
  core::TaskOrder order;
  arena.execute([&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, grain),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                        const core::TaskOrder::Task task(order);
                        for (std::size_t i = range.begin(); i != range.end(); ++i) body(i);
                      });
  });
  order.wait();
}

glm::vec3 point_at(const PreparedView& view, int x, int y, float depth_m) {
  return glm::vec3(view.camera.back_project({x + 0.5, y + 0.5}, static_cast<double>(depth_m)));
}

/// The neighbours' difference along one axis: over both if they belong to the same surface as
/// the pixel, else over one; 0 if none does.
glm::vec3 tangent(const PreparedView& view, const core::Image<float>& depth, int x, int y,
                  int dx, int dy) {
  const float here = depth(x, y);
  const auto side = [&](int sign) -> glm::vec3 {
    const int u = x + sign * dx, v = y + sign * dy;
    if (!depth.contains(u, v)) return glm::vec3(0.0F);
    const float there = depth(u, v);
    if (there <= 0.0F || std::abs(there - here) > kEdgeShare * here) return glm::vec3(0.0F);
    return static_cast<float>(sign) *
           (point_at(view, u, v, there) - point_at(view, x, y, here));
  };
  return side(1) + side(-1);
}

/// Unit, towards the camera; 0 if the neighbours do not tell.
glm::vec3 normal_from_depth(const PreparedView& view, const core::Image<float>& depth, int x,
                            int y) {
  const glm::vec3 cross =
      glm::cross(tangent(view, depth, x, y, 1, 0), tangent(view, depth, x, y, 0, 1));
  const float length = glm::length(cross);
  if (!(length > 0.0F)) return glm::vec3(0.0F);
  const glm::vec3 n = cross / length;
  return glm::dot(n, point_at(view, x, y, depth(x, y))) < 0.0F ? n : -n;
}

PreparedView prepared(const DepthView& view, const DepthFusionOptions& options,
                      tbb::task_arena& arena) {
  PreparedView result;
  result.camera = view.intrinsics;
  result.R_world_camera = glm::mat3_cast(view.T_world_camera.rotation());
  result.p_world_camera_m = view.T_world_camera.translation_m();
  const int width = view.intrinsics.width_px, height = view.intrinsics.height_px;
  core::Image<float> depth(width, height, 0.0F);
  for (std::size_t k = 0; k < depth.size(); ++k) {
    const auto d = static_cast<double>(view.depth_m->pixels()[k]);
    if (d >= options.min_depth_m && d <= options.max_depth_m) {  // Also false for NaN.
      depth.pixels()[k] = static_cast<float>(d);
    }
  }
  result.depth_m = core::Image<float>(width, height, 0.0F);
  result.normal = core::Image<glm::vec3>(width, height, glm::vec3(0.0F));
  result.cosine = core::Image<float>(width, height, 0.0F);
  const glm::mat3 R_camera_world = glm::transpose(glm::mat3(result.R_world_camera));
  const auto least_cosine =
      static_cast<float>(std::cos(options.max_grazing_deg / 180.0 * std::numbers::pi));
  for_each(arena, static_cast<std::size_t>(height), 8, [&](std::size_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < width; ++x) {
      if (depth(x, y) <= 0.0F) continue;
      const glm::vec3 n = view.normal != nullptr ? R_camera_world * (*view.normal)(x, y)
                                                 : normal_from_depth(result, depth, x, y);
      const glm::vec3 sight = glm::normalize(point_at(result, x, y, 1.0F));
      const float cosine = -glm::dot(n, sight);
      if (!(cosine > least_cosine)) continue;  // Also without a normal, or with a NaN.
      result.depth_m(x, y) = depth(x, y);
      result.normal(x, y) = n;
      result.cosine(x, y) = std::min(1.0F, cosine);
    }
  });
  return result;
}

void check_view(const DepthView& view) {
  SEGSIM_CHECK(view.depth_m != nullptr, "a view has depth");
  const auto fits = [&](const auto& image) {
    return image.width_px() == view.intrinsics.width_px &&
           image.height_px() == view.intrinsics.height_px;
  };
  SEGSIM_CHECK(fits(*view.depth_m), "size of the depth image");
  SEGSIM_CHECK(view.normal == nullptr || fits(*view.normal), "size of the normal image");
  const glm::dvec3& eye_m = view.T_world_camera.translation_m();
  const double far_m = std::max({std::abs(eye_m.x), std::abs(eye_m.y), std::abs(eye_m.z)});
  if (!(far_m < kLargestPlace_m)) {
    throw core::InputError::expected("depth fusion", "cameras within 10 km of the origin",
                                     "one farther away");
  }
}

/// The keys of one row of pixels, nearly without repetition.
class KeyCollector {
 public:
  KeyCollector(double block_m, std::vector<PlaceKey>& keys) : block_m_(block_m), keys_(keys) {}

  /// The blocks that a cube of half size `half_m` touches.
  void add(const glm::dvec3& p_m, double half_m) {
    const glm::ivec3 lo(glm::floor((p_m - half_m) / block_m_));
    const glm::ivec3 hi(glm::floor((p_m + half_m) / block_m_));
    for (int z = lo.z; z <= hi.z; ++z) {
      for (int y = lo.y; y <= hi.y; ++y) {
        for (int x = lo.x; x <= hi.x; ++x) put(internal::place_key(x, y, z));
      }
    }
  }

 private:
  void put(PlaceKey key) {
    PlaceKey& seen = recent_[(key ^ (key >> 20U) ^ (key >> 39U)) % recent_.size()];
    if (seen == key) return;
    seen = key;
    keys_.push_back(key);
  }

  double block_m_;
  std::vector<PlaceKey>& keys_;
  std::array<PlaceKey, 64> recent_{};
};

}  // namespace

struct DepthFusion::Volume {
  explicit Volume(const DepthFusionOptions& wanted)
      : options(wanted),
        arena(wanted.threads == 0 ? tbb::task_arena::automatic : wanted.threads) {
    field.voxel_m = wanted.voxel_m;
  }

  void allocate(const PreparedView& view);
  void integrate(const PreparedView& view);
  void integrate(const PreparedView& view, VoxelBlock& block) const;
  [[nodiscard]] bool may_see(const PreparedView& view, const VoxelBlock& block) const;

  DepthFusionOptions options;
  tbb::task_arena arena;
  internal::DistanceVolume field;
};

/// Makes the blocks within the truncation of what the view sees.
void DepthFusion::Volume::allocate(const PreparedView& view) {
  const double block_m = kBlockSide * field.voxel_m;
  const int height = view.camera.height_px;
  // Neighbouring pixels see the same blocks.
  const int stride = std::max(1, view.camera.width_px / 320);
  std::vector<std::vector<PlaceKey>> rows(
      static_cast<std::size_t>((height + stride - 1) / stride));
  for_each(arena, rows.size(), 4, [&](std::size_t row) {
    KeyCollector keys(block_m, rows[row]);
    const int y = static_cast<int>(row) * stride;
    for (int x = 0; x < view.camera.width_px; x += stride) {
      if (view.depth_m(x, y) <= 0.0F) continue;
      const glm::dvec3 p_m =
          view.p_world_camera_m +
          view.R_world_camera * glm::dvec3(point_at(view, x, y, view.depth_m(x, y)));
      const glm::dvec3 n = view.R_world_camera * glm::dvec3(view.normal(x, y));
      // Cubes of one voxel to every side, at most two voxels apart: no gap between them.
      const int steps =
          static_cast<int>(std::ceil(options.truncation_m / (2.0 * field.voxel_m)));
      for (int s = -steps; s <= steps; ++s) {
        keys.add(p_m + n * (options.truncation_m * s / steps), field.voxel_m);
      }
    }
  });
  std::vector<PlaceKey> all;
  for (const auto& row : rows) all.insert(all.end(), row.begin(), row.end());
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  for (const PlaceKey key : all) {
    if (field.index.contains(key)) continue;
    if (field.blocks.size() >= options.max_blocks) {
      throw core::InputError::expected(
          "depth fusion", "a surface within " + std::to_string(options.max_blocks) + " blocks",
          "a larger one; use larger voxels");
    }
    field.index.emplace(key, field.blocks.size());
    field.blocks.emplace_back().place = internal::place_of(key);
  }
}

bool DepthFusion::Volume::may_see(const PreparedView& view, const VoxelBlock& block) const {
  const double half_m = 0.5 * kBlockSide * field.voxel_m;
  const double radius_m = half_m * std::numbers::sqrt3;
  const glm::dvec3 center_m =
      (glm::dvec3(block.place) * static_cast<double>(kBlockSide)) * field.voxel_m + half_m;
  const glm::dvec3 p =
      glm::transpose(view.R_world_camera) * (center_m - view.p_world_camera_m);
  if (p.z < -radius_m || p.z > options.max_depth_m + radius_m) return false;
  if (p.z < 2.0 * radius_m) return glm::length(p) < 4.0 * radius_m;  // Near: look closely.
  const glm::dvec2 px = view.camera.project(p);
  const double reach_px =
      std::max(view.camera.fx_px, view.camera.fy_px) * 2.0 * radius_m / (p.z - radius_m);
  return px.x > -reach_px && px.y > -reach_px && px.x < view.camera.width_px + reach_px &&
         px.y < view.camera.height_px + reach_px;
}

void DepthFusion::Volume::integrate(const PreparedView& view, VoxelBlock& block) const {
  const auto truncation = static_cast<float>(options.truncation_m);
  const auto full_weight_to = static_cast<float>(-0.5 * options.voxel_m);
  const glm::dmat3 R_camera_world = glm::transpose(view.R_world_camera);
  const glm::dvec3 first_m =
      glm::dvec3(block.place * kBlockSide) * field.voxel_m - view.p_world_camera_m;
  const glm::vec3 first(R_camera_world * first_m);
  const glm::mat3 step(R_camera_world * field.voxel_m);
  const auto fx = static_cast<float>(view.camera.fx_px),
             fy = static_cast<float>(view.camera.fy_px);
  const auto cx = static_cast<float>(view.camera.cx_px),
             cy = static_cast<float>(view.camera.cy_px);
  const auto width = static_cast<float>(view.camera.width_px);
  const auto height = static_cast<float>(view.camera.height_px);
  const auto nearest = static_cast<float>(0.5 * options.min_depth_m);
  for (int k = 0; k < kBlockVoxels; ++k) {
    const glm::ivec3 place(k % kBlockSide, k / kBlockSide % kBlockSide,
                           k / (kBlockSide * kBlockSide));
    const glm::vec3 p = first + step * glm::vec3(place);
    if (p.z < nearest) continue;
    const float u = fx * p.x / p.z + cx, v = fy * p.y / p.z + cy;
    if (!(u >= 0.0F && v >= 0.0F && u < width && v < height)) continue;
    const int x = static_cast<int>(u), y = static_cast<int>(v);
    const float depth = view.depth_m(x, y);
    if (depth <= 0.0F) continue;
    const glm::vec3 seen = point_at(view, x, y, depth);
    const float distance = glm::dot(view.normal(x, y), p - seen);
    // Behind the surface, seen along the ray as well as across it.
    if (distance < -truncation || p.z - depth > 4.0F * truncation) continue;
    float weight = view.cosine(x, y);
    if (distance < full_weight_to) {
      const float share = (distance + truncation) / (full_weight_to + truncation);
      weight *= share * share;
    }
    if (weight <= 0.0F) continue;
    const auto slot = static_cast<std::size_t>(k);
    const float before = block.weight[slot];
    block.weight[slot] = before + weight;
    block.distance[slot] =
        (block.distance[slot] * before + std::min(distance, truncation) * weight) /
        (before + weight);
  }
}

void DepthFusion::Volume::integrate(const PreparedView& view) {
  for_each(arena, field.blocks.size(), 64, [&](std::size_t i) {
    VoxelBlock& block = field.blocks[i];
    if (may_see(view, block)) integrate(view, block);
  });
}

DepthFusion::DepthFusion(const DepthFusionOptions& options) {
  SEGSIM_CHECK(options.voxel_m > 0.0 && std::isfinite(options.voxel_m), "voxel_m");
  SEGSIM_CHECK(options.truncation_m >= 2.0 * options.voxel_m, "truncation_m");
  SEGSIM_CHECK(options.min_depth_m > 0.0 && options.max_depth_m > options.min_depth_m,
               "depth range");
  SEGSIM_CHECK(options.max_grazing_deg > 0.0 && options.max_grazing_deg < 90.0,
               "max_grazing_deg");
  SEGSIM_CHECK(options.min_weight >= 0.0 && options.threads >= 0, "min_weight, threads");
  volume_ = std::make_unique<Volume>(options);
}

DepthFusion::~DepthFusion() = default;
DepthFusion::DepthFusion(DepthFusion&&) noexcept = default;
DepthFusion& DepthFusion::operator=(DepthFusion&&) noexcept = default;

void DepthFusion::reserve(const DepthView& view) {
  check_view(view);
  volume_->allocate(prepared(view, volume_->options, volume_->arena));
}

void DepthFusion::add(const DepthView& view) {
  check_view(view);
  const PreparedView ready = prepared(view, volume_->options, volume_->arena);
  volume_->allocate(ready);
  volume_->integrate(ready);
}

void DepthFusion::add_reserved(const DepthView& view) {
  check_view(view);
  volume_->integrate(prepared(view, volume_->options, volume_->arena));
}

std::size_t DepthFusion::block_count() const { return volume_->field.blocks.size(); }

std::size_t DepthFusion::bytes() const { return block_count() * sizeof(VoxelBlock); }

sim::TriangleMesh DepthFusion::surface() const {
  return internal::extract_surface(volume_->field, volume_->options.truncation_m,
                                   volume_->options.min_weight);
}

}  // namespace segsim::worlds
