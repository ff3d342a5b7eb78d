#include "reconstruction/training/densify.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>

#include "core/check.h"
#include "renderer/scene/depth_normal.h"

namespace segsim::reconstruction {
namespace {

constexpr float kSplitOffset = 0.6F, kSplitLong = 0.7F, kSplitShort = 0.9F;
constexpr float kNewOpacity = 0.9F;
constexpr int kHoleStep_px = 2;

void check_lengths(const SurfelStatistics& s) {
  const std::size_t count = s.gradient.size();
  SEGSIM_CHECK(s.max_weight.size() == count && s.opacity.size() == count &&
                   s.long_scale_m.size() == count && s.short_scale_m.size() == count,
               "statistics of different lengths");
}

/// A rotation whose third column is the normal.
glm::quat facing(const glm::vec3& normal) {
  const glm::vec3 helper =
      std::abs(normal.z) < 0.9F ? glm::vec3(0.0F, 0.0F, 1.0F) : glm::vec3(1.0F, 0.0F, 0.0F);
  const glm::vec3 t_u = glm::normalize(glm::cross(helper, normal));
  return glm::normalize(glm::quat_cast(glm::mat3(t_u, glm::cross(normal, t_u), normal)));
}

/// 21 bits of each axis.
std::int64_t voxel_key(const glm::vec3& position_m, double voxel_m) {
  std::int64_t key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto cell =
        static_cast<std::int64_t>(std::floor(static_cast<double>(position_m[axis]) / voxel_m));
    key = (key << 21) | ((cell + (1 << 20)) & ((1 << 21) - 1));
  }
  return key;
}

}  // namespace

std::vector<std::int64_t> surfels_to_split(const SurfelStatistics& s,
                                           const GeometryConfig::Densify& config) {
  check_lengths(s);
  const auto count = static_cast<std::int64_t>(s.gradient.size());
  std::vector<std::int64_t> chosen;
  for (std::int64_t i = 0; i < count; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (s.gradient[k] > config.min_gradient && s.long_scale_m[k] > config.min_scale_m) {
      chosen.push_back(i);
    }
  }
  const auto most = std::max<std::int64_t>(
      0, std::min(config.max_surfels - count,
                  static_cast<std::int64_t>(config.max_growth * static_cast<double>(count))));
  if (static_cast<std::int64_t>(chosen.size()) > most) {
    const auto stronger = [&](std::int64_t a, std::int64_t b) {
      const float ga = s.gradient[static_cast<std::size_t>(a)];
      const float gb = s.gradient[static_cast<std::size_t>(b)];
      return ga != gb ? ga > gb : a < b;
    };
    std::nth_element(chosen.begin(), chosen.begin() + most, chosen.end(), stronger);
    chosen.resize(static_cast<std::size_t>(most));
    std::sort(chosen.begin(), chosen.end());
  }
  return chosen;
}

std::vector<std::int64_t> surfels_to_keep(const SurfelStatistics& s,
                                          const GeometryConfig::Densify& config,
                                          double extent_m) {
  check_lengths(s);
  std::vector<std::int64_t> kept;
  for (std::size_t i = 0; i < s.gradient.size(); ++i) {
    const bool fits = s.long_scale_m[i] <= config.max_scale_extent * extent_m;
    if (fits && s.opacity[i] >= config.min_opacity && s.max_weight[i] >= config.min_weight) {
      kept.push_back(static_cast<std::int64_t>(i));
    }
  }
  return kept;
}

RawSurfels split_surfels(RawSurfels& raw) {
  RawSurfels other = raw;
  const auto count = static_cast<std::size_t>(raw.count());
  for (std::size_t i = 0; i < count; ++i) {
    const float* q = raw.rotation.data() + 4 * i;
    const glm::mat3 axes = glm::mat3_cast(glm::normalize(glm::quat(q[0], q[1], q[2], q[3])));
    float* log_scale = raw.log_scale.data() + 2 * i;
    const int longer = log_scale[1] > log_scale[0] ? 1 : 0;
    const glm::vec3 offset = kSplitOffset * std::exp(log_scale[longer]) * axes[longer];
    for (int axis = 0; axis < 3; ++axis) {
      raw.position_m[3 * i + static_cast<std::size_t>(axis)] += offset[axis];
      other.position_m[3 * i + static_cast<std::size_t>(axis)] -= offset[axis];
    }
    log_scale[longer] += std::log(kSplitLong);
    log_scale[1 - longer] += std::log(kSplitShort);
  }
  other.log_scale = raw.log_scale;
  return other;
}

void HoleFiller::add(const glm::vec3& position_m, const glm::vec3& normal, double size_m,
                     const core::Rgb8& rgb) {
  const glm::quat q = facing(normal);
  const auto log_size = static_cast<float>(std::log(size_m));
  const std::size_t coefficients =
      static_cast<std::size_t>((pending_.sh_degree + 1) * (pending_.sh_degree + 1));
  pending_.position_m.insert(pending_.position_m.end(),
                             {position_m.x, position_m.y, position_m.z});
  pending_.rotation.insert(pending_.rotation.end(), {q.w, q.x, q.y, q.z});
  pending_.log_scale.insert(pending_.log_scale.end(), {log_size, log_size});
  pending_.opacity_logit.push_back(std::log(kNewOpacity / (1.0F - kNewOpacity)));
  const glm::vec3 color = (glm::vec3(rgb.r, rgb.g, rgb.b) / 255.0F - 0.5F) / renderer::kShC0;
  pending_.sh.insert(pending_.sh.end(), {color.r, color.g, color.b});
  pending_.sh.resize(pending_.sh.size() + 3 * (coefficients - 1), 0.0F);
}

void HoleFiller::add_view(const TrainingView& view, const core::CameraPose& T_world_camera,
                          const core::CameraIntrinsics& intrinsics,
                          std::span<const float> alpha, double min_depth_m,
                          double max_depth_m) {
  if (view.depth_m.empty()) return;
  SEGSIM_CHECK(alpha.size() == view.depth_m.size(),
               std::to_string(alpha.size()) + " pixels of alpha");
  core::Image<glm::vec3> normals;  // Row by row, where there are holes.
  for (int y = 0; y < view.depth_m.height_px(); y += kHoleStep_px) {
    const float* alpha_row =
        alpha.data() + static_cast<std::ptrdiff_t>(y) * view.depth_m.width_px();
    bool row_is_known = false;
    for (int x = 0; x < view.depth_m.width_px(); x += kHoleStep_px) {
      if (alpha_row[x] >= kHoleAlpha || (!view.valid.empty() && view.valid(x, y) == 0)) {
        continue;
      }
      const double depth_m = view.depth_m(x, y);
      if (!(depth_m > min_depth_m && depth_m < max_depth_m)) continue;
      const glm::vec3 place_m(
          (T_world_camera * core::Point<core::frame::Camera>{intrinsics.back_project(
                                {x + 0.5, y + 0.5}, depth_m)})
              .xyz_m);
      if (!places_.insert(voxel_key(place_m, voxel_m_)).second) continue;
      if (normals.empty()) normals = {view.depth_m.width_px(), view.depth_m.height_px()};
      if (!row_is_known) {
        renderer::depth_normal_rows(view.depth_m, intrinsics, T_world_camera, y, y + 1,
                                    normals);
        row_is_known = true;
      }
      glm::vec3 normal = normals(x, y);
      if (normal == glm::vec3(0.0F)) {
        normal = glm::normalize(glm::vec3(T_world_camera.translation_m()) - place_m);
      }
      add(place_m, normal, 0.5 * kHoleStep_px * depth_m / intrinsics.fx_px, view.rgb(x, y));
    }
  }
}

void HoleFiller::restore(RawSurfels pending) {
  SEGSIM_CHECK(pending.sh_degree == pending_.sh_degree, "surfels of another SH degree");
  pending_ = std::move(pending);
  places_.clear();
  for (std::size_t i = 0; i < pending_.position_m.size(); i += 3) {
    const float* p = pending_.position_m.data() + i;
    places_.insert(voxel_key(glm::vec3(p[0], p[1], p[2]), voxel_m_));
  }
}

RawSurfels HoleFiller::take(std::int64_t most) {
  const std::size_t sh_size =
      pending_.sh.size() / std::max<std::size_t>(pending_.opacity_logit.size(), 1);
  const auto count =
      static_cast<std::size_t>(std::clamp<std::int64_t>(most, 0, pending_.count()));
  RawSurfels taken = std::move(pending_);
  taken.position_m.resize(3 * count);
  taken.log_scale.resize(2 * count);
  taken.rotation.resize(4 * count);
  taken.opacity_logit.resize(count);
  taken.sh.resize(sh_size * count);
  pending_ = {};
  pending_.sh_degree = taken.sh_degree;
  places_.clear();
  return taken;
}

}  // namespace segsim::reconstruction
