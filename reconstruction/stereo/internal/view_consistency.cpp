#include "reconstruction/stereo/internal/view_consistency.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <glm/vec2.hpp>

#include "reconstruction/stereo/internal/working_view.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr float kTightest = 0.01F, kLoosest = 0.03F;
constexpr std::size_t kPatchShare = 2500;
/// Neighbours in a patch differ by less than this share of their inverse depth.
constexpr float kPatchStep = 0.05F;

float tolerance(float inverse_m, float step_inverse_m) {
  return std::clamp(step_inverse_m, kTightest * inverse_m, kLoosest * inverse_m);
}

/// Inverse depth at an image position: between the four pixels around it if all of them are
/// near `expected`, else that of the nearest pixel. NaN out of the image.
float inverse_at(const core::Image<float>& inverse_m, float px, float py, float expected,
                 float near) {
  const float u = px - 0.5F, v = py - 0.5F;
  if (!(u > -0.5F && v > -0.5F)) return std::nanf("");
  // u = px - 0.5: the pixel that px lies in.
  const int nearest_x = static_cast<int>(px), nearest_y = static_cast<int>(py);
  if (!inverse_m.contains(nearest_x, nearest_y)) return std::nanf("");
  const float nearest = inverse_m(nearest_x, nearest_y);
  if (!(u >= 0.0F && v >= 0.0F)) return nearest;
  const int x = static_cast<int>(u), y = static_cast<int>(v);
  if (!inverse_m.contains(x + 1, y + 1)) return nearest;
  const std::array<float, 4> four{inverse_m(x, y), inverse_m(x + 1, y), inverse_m(x, y + 1),
                                  inverse_m(x + 1, y + 1)};
  for (const float value : four) {
    if (!(std::abs(value - expected) <= near)) return nearest;
  }
  const float s = u - static_cast<float>(x), t = v - static_cast<float>(y);
  const float top = four[0] + s * (four[1] - four[0]);
  const float bottom = four[2] + s * (four[3] - four[2]);
  return top + t * (bottom - top);
}

/// Removes connected patches of fewer pixels.
void remove_patches(core::Image<float>& depth_m, std::size_t fewest) {
  const int width = depth_m.width_px(), height = depth_m.height_px();
  core::Image<std::uint8_t> visited(width, height);
  std::vector<glm::ivec2> patch;
  constexpr std::array<glm::ivec2, 4> kAround{{{-1, 0}, {1, 0}, {0, -1}, {0, 1}}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (visited(x, y) != 0 || std::isnan(depth_m(x, y))) continue;
      patch.assign(1, {x, y});
      visited(x, y) = 1;
      for (std::size_t k = 0; k < patch.size(); ++k) {
        const glm::ivec2 at = patch[k];
        const float own = depth_m(at.x, at.y);
        for (const glm::ivec2& step : kAround) {
          const glm::ivec2 next = at + step;
          if (!depth_m.contains(next.x, next.y) || visited(next.x, next.y) != 0) continue;
          if (!(std::abs(depth_m(next.x, next.y) - own) <= kPatchStep * own)) continue;
          visited(next.x, next.y) = 1;
          patch.push_back(next);
        }
      }
      if (patch.size() >= fewest) continue;
      for (const glm::ivec2& at : patch) depth_m(at.x, at.y) = std::nanf("");
    }
  }
}

}  // namespace

core::Image<float> agreed_depth(std::size_t reference, std::span<const std::uint32_t> others,
                                std::span<const MatchedView> views,
                                const core::CameraIntrinsics& camera, int fewest) {
  const MatchedView& own = views[reference];
  const int width = own.inverse_m.width_px(), height = own.inverse_m.height_px();
  std::vector<ViewWarp> warps;
  for (const std::uint32_t other : others) {
    warps.push_back(warp_between(own.T_world_camera, views[other].T_world_camera, camera));
  }
  core::Image<float> depth_m(width, height, std::nanf(""));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float inverse_m = own.inverse_m(x, y);
      if (!(inverse_m > 0.0F)) continue;
      const glm::vec3 px(static_cast<float>(x) + 0.5F, static_cast<float>(y) + 0.5F, 1.0F);
      int agree = 0, through = 0;
      float sum = inverse_m;
      for (std::size_t k = 0; k < others.size(); ++k) {
        const glm::vec3 h = warps[k].a * px + inverse_m * warps[k].b;
        if (!(h.z > 1e-6F)) continue;
        const MatchedView& other = views[others[k]];
        const float expected = inverse_m / h.z;
        const float near =
            tolerance(expected, std::max(other.step_inverse_m, own.step_inverse_m / h.z));
        const float found =
            inverse_at(other.inverse_m, h.x / h.z, h.y / h.z, expected, 2.0F * near);
        if (std::abs(found - expected) <= near) {
          ++agree;
          sum += found * h.z;
        } else if (found < expected) {
          ++through;
        }
      }
      if (agree < fewest || agree < through) continue;
      depth_m(x, y) = static_cast<float>(agree + 1) / sum;
    }
  }
  remove_patches(depth_m, depth_m.size() / kPatchShare);
  return depth_m;
}

}  // namespace segsim::reconstruction::internal
