#include "reconstruction/stereo/internal/slanted_refinement.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <glm/vec2.hpp>

namespace segsim::reconstruction::internal {
namespace {

constexpr int kFitRadius_px = 3;
constexpr int kFewestFitted = 12;
/// Windows of 9 x 9 pixels, of which every other is looked at.
constexpr int kReach_px = 4, kStride_px = 2, kSide = 2 * kReach_px / kStride_px + 1;
constexpr int kSamples = kSide * kSide;
constexpr float kNoise = (2.0F / 255.0F) * (2.0F / 255.0F) * 65280.0F * 65280.0F;
/// Without so much contrast, smoothness knows better.
constexpr float kSmallestVariance = 2.0F * kNoise;
/// Of this grey difference, a pixel of the window counts half.
constexpr float kSameSurface = 12.0F / 255.0F * 65280.0F;
constexpr float kLeastGain = 0.005F;
/// Planes this near to one another, in steps of the sweep, are one.
constexpr float kSamePlane = 0.1F;

/// Inverse depth around a pixel: a plane's is linear in the image.
struct LocalPlane {
  float inverse_m = 0.0F;
  glm::vec2 gradient{0.0F};  ///< [1/(m px)]
};

/// Least squares over what lies near the pixel's own depth.
LocalPlane fit(const core::Image<float>& inverse_m, int x, int y, float tolerance) {
  const float own = inverse_m(x, y);
  float xx = 0, xy = 0, yy = 0, sx = 0, sy = 0, sw = 0, xw = 0, yw = 0, n = 0;
  for (int dy = -kFitRadius_px; dy <= kFitRadius_px; ++dy) {
    for (int dx = -kFitRadius_px; dx <= kFitRadius_px; ++dx) {
      if (!inverse_m.contains(x + dx, y + dy)) continue;
      const float off = inverse_m(x + dx, y + dy) - own;
      const auto reach = static_cast<float>(1 + std::max(std::abs(dx), std::abs(dy)));
      if (!(std::abs(off) <= tolerance * reach)) continue;
      const auto u = static_cast<float>(dx), v = static_cast<float>(dy);
      xx += u * u, xy += u * v, yy += v * v, sx += u, sy += v;
      sw += off, xw += u * off, yw += v * off, n += 1.0F;
    }
  }
  LocalPlane plane{own, glm::vec2(0.0F)};
  if (n < kFewestFitted) return plane;
  const float cxx = xx - sx * sx / n, cxy = xy - sx * sy / n, cyy = yy - sy * sy / n;
  const float cxw = xw - sx * sw / n, cyw = yw - sy * sw / n;
  const float determinant = cxx * cyy - cxy * cxy;
  if (!(determinant > 0.05F * cxx * cyy)) return plane;
  plane.gradient = {(cyy * cxw - cxy * cyw) / determinant,
                    (cxx * cyw - cxy * cxw) / determinant};
  plane.inverse_m = own + (sw - plane.gradient.x * sx - plane.gradient.y * sy) / n;
  return plane;
}

/// The reference around one pixel.
struct Window {
  std::array<float, kSamples> grey, weight;
  float weights = 0.0F, mean = 0.0F, variance = 0.0F;
};

Window window_at(const core::Image<std::uint16_t>& picture, int x, int y) {
  Window window;
  const auto middle = static_cast<float>(picture(x, y));
  float sum = 0.0F, square = 0.0F;
  int k = 0;
  for (int dy = -kReach_px; dy <= kReach_px; dy += kStride_px) {
    for (int dx = -kReach_px; dx <= kReach_px; dx += kStride_px, ++k) {
      const bool inside = picture.contains(x + dx, y + dy);
      const float off = inside ? static_cast<float>(picture(x + dx, y + dy)) - middle : 0.0F;
      const float share = off / kSameSurface;
      window.grey[k] = off;
      window.weight[k] = inside ? 1.0F / (1.0F + share * share) : 0.0F;
      window.weights += window.weight[k];
      sum += window.weight[k] * off;
      square += window.weight[k] * off * off;
    }
  }
  window.mean = sum / window.weights;
  window.variance = std::max(0.0F, square / window.weights - window.mean * window.mean);
  return window;
}

/// Tries planes at one pixel.
class Trials {
 public:
  Trials(std::span<const core::Image<std::uint16_t>* const> sources,
         std::span<const ViewWarp> warps)
      : sources_(sources), warps_(warps), costs_(sources.size()) {}

  /// Mean cost, in [0, 2], of the better half of the sources.
  float cost(const Window& window, int x, int y, const LocalPlane& plane) {
    for (std::size_t s = 0; s < sources_.size(); ++s) {
      costs_[s] = source_cost(window, x, y, plane, *sources_[s], warps_[s]);
    }
    std::sort(costs_.begin(), costs_.end());
    const std::size_t wanted = (costs_.size() + 1) / 2;
    float sum = 0.0F;
    for (std::size_t s = 0; s < wanted; ++s) sum += costs_[s];
    return sum / static_cast<float>(wanted);
  }

 private:
  static float source_cost(const Window& window, int x, int y, const LocalPlane& plane,
                           const core::Image<std::uint16_t>& source, const ViewWarp& map) {
    const glm::vec3 by_x = map.a[0] + plane.gradient.x * map.b;
    const glm::vec3 by_y = map.a[1] + plane.gradient.y * map.b;
    const glm::vec3 middle =
        map.a * glm::vec3(static_cast<float>(x) + 0.5F, static_cast<float>(y) + 0.5F, 1.0F) +
        plane.inverse_m * map.b;
    const auto right = static_cast<float>(source.width_px() - 1);
    const auto bottom = static_cast<float>(source.height_px() - 1);
    const int width = source.width_px();
    float sum = 0.0F, square = 0.0F, product = 0.0F;
    int k = 0;
    for (int dy = -kReach_px; dy <= kReach_px; dy += kStride_px) {
      for (int dx = -kReach_px; dx <= kReach_px; dx += kStride_px, ++k) {
        const glm::vec3 h =
            middle + static_cast<float>(dx) * by_x + static_cast<float>(dy) * by_y;
        if (!(h.z > 1e-6F)) return 1.0F;
        const float u = h.x / h.z - 0.5F, v = h.y / h.z - 0.5F;
        if (!(u >= 0.0F && v >= 0.0F && u < right && v < bottom)) {
          if (window.weight[k] == 0.0F) continue;
          return 1.0F;
        }
        const int iu = static_cast<int>(u), iv = static_cast<int>(v);
        const float s = u - static_cast<float>(iu), t = v - static_cast<float>(iv);
        const std::uint16_t *p = source.row(iv) + iu, *q = p + width;
        const auto p0 = static_cast<float>(p[0]), q0 = static_cast<float>(q[0]);
        const float upper = p0 + s * (static_cast<float>(p[1]) - p0);
        const float lower = q0 + s * (static_cast<float>(q[1]) - q0);
        const float grey = upper + t * (lower - upper) - 32640.0F;
        const float weighted = window.weight[k] * grey;
        sum += weighted, square += weighted * grey, product += weighted * window.grey[k];
      }
    }
    const float mean = sum / window.weights;
    const float variance = std::max(0.0F, square / window.weights - mean * mean) + kNoise;
    const float covariance = product / window.weights - mean * window.mean;
    return 1.0F - covariance / std::sqrt(variance * (window.variance + kNoise));
  }

  std::span<const core::Image<std::uint16_t>* const> sources_;
  std::span<const ViewWarp> warps_;
  std::vector<float> costs_;
};

}  // namespace

void refine_slanted(const core::Image<std::uint16_t>& reference,
                    std::span<const core::Image<std::uint16_t>* const> sources,
                    std::span<const ViewWarp> warps, float step_inverse_m,
                    core::Image<float>& inverse_m) {
  const int width = inverse_m.width_px(), height = inverse_m.height_px();
  core::Image<LocalPlane> fitted(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (inverse_m(x, y) > 0.0F) fitted(x, y) = fit(inverse_m, x, y, step_inverse_m);
    }
  }
  constexpr int kApart_px = 3;
  constexpr std::array<glm::ivec2, 4> kNeighbours{
      {{-kApart_px, 0}, {kApart_px, 0}, {0, -kApart_px}, {0, kApart_px}}};
  Trials trials(sources, warps);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float start = inverse_m(x, y);
      if (!(start > 0.0F)) continue;
      const Window window = window_at(reference, x, y);
      if (window.variance < kSmallestVariance) {
        // What neighbours agree on smooths the steps between planes.
        inverse_m(x, y) = std::max(fitted(x, y).inverse_m, 0.5F * start);
        continue;
      }
      LocalPlane best = fitted(x, y);
      float lowest = trials.cost(window, x, y, best);
      const auto attempt = [&](const LocalPlane& plane) {
        // A plane that a neighbour hands on may lie anywhere; further off it is another one.
        if (!(std::abs(plane.inverse_m - start) <= 3.0F * step_inverse_m)) return;
        if (!(plane.inverse_m > 0.25F * start)) return;
        const float cost = trials.cost(window, x, y, plane);
        if (cost >= lowest - kLeastGain) return;
        lowest = cost, best = plane;
      };
      attempt({start, glm::vec2(0.0F)});
      for (const glm::ivec2& to : kNeighbours) {
        if (!inverse_m.contains(x + to.x, y + to.y)) continue;
        const LocalPlane& other = fitted(x + to.x, y + to.y);
        if (!(other.inverse_m > 0.0F)) continue;
        const LocalPlane handed{other.inverse_m - other.gradient.x * static_cast<float>(to.x) -
                                    other.gradient.y * static_cast<float>(to.y),
                                other.gradient};
        if (std::abs(handed.inverse_m - best.inverse_m) < kSamePlane * step_inverse_m)
          continue;
        attempt(handed);
      }
      for (const float share : {0.5F, 0.25F, 0.12F}) {
        const LocalPlane middle = best;
        for (const float sign : {-1.0F, 1.0F}) {
          attempt({middle.inverse_m + sign * share * step_inverse_m, middle.gradient});
        }
      }
      inverse_m(x, y) = best.inverse_m;
    }
  }
}

}  // namespace segsim::reconstruction::internal
