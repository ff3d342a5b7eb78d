#include "sim/sensors/depth_sensor.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/check.h"

namespace segsim::sim {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

// What the layers of the noise are used for.
enum Layer : std::uint32_t { kAlongRay, kJitterX, kJitterY, kFlies, kFlightPlace };

// Redwood's numbers.
constexpr float kJitter_px = 0.25F;
constexpr float kDisparity_m = 35.130F;  ///< Disparity times depth.
constexpr float kDisparityNoise = 0.027778F;
constexpr float kDisparitySteps = 8.0F;  ///< Of one disparity.
constexpr float kRedwoodRange_m = 10.0F;

/// One image of numbers.
std::vector<float> normals(const PixelNoise& noise, Layer layer, std::size_t count) {
  std::vector<float> values(count);
  noise.fill_normal(layer, 0, values);
  return values;
}

std::vector<float> uniforms(const PixelNoise& noise, Layer layer, std::size_t count) {
  std::vector<float> values(count);
  noise.fill_uniform(layer, 0, values);
  return values;
}

/// Step 1: the place that a pixel is read at, then the grid of every second pixel.
void jitter(const PixelNoise& noise, const core::Image<float>& from, core::Image<float>& to) {
  const std::vector<float> dx = normals(noise, kJitterX, from.size());
  const std::vector<float> dy = normals(noise, kJitterY, from.size());
  const int w = from.width_px(), h = from.height_px();
  std::size_t k = 0;
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x, ++k) {
      // At most 5.8 sigma = 1.45 px: adding 2.5 and cutting rounds, without a negative number.
      const int u = static_cast<int>(static_cast<float>(x) + kJitter_px * dx[k] + 2.5F) - 2;
      const int v = static_cast<int>(static_cast<float>(y) + kJitter_px * dy[k] + 2.5F) - 2;
      to(x, y) = from(std::clamp(u, 0, w - 1) & ~1, std::clamp(v, 0, h - 1) & ~1);
    }
  }
}

/// Step 2. @param seen  True depths. @param to  Changed where a pixel flies.
void let_edges_fly(const DepthModel& model, const PixelNoise& noise,
                   const core::Image<float>& seen, core::Image<float>& to) {
  const std::vector<float> chance = uniforms(noise, kFlies, seen.size());
  const std::vector<float> place = uniforms(noise, kFlightPlace, seen.size());
  const int w = seen.width_px(), h = seen.height_px();
  const auto probability = static_cast<float>(model.flying_pixels);
  std::size_t k = 0;
  for (int y = 0; y < h; ++y) {
    const float* above = seen.row(std::max(y - 1, 0));
    const float* here = seen.row(y);
    const float* below = seen.row(std::min(y + 1, h - 1));
    for (int x = 0; x < w; ++x, ++k) {
      if (!(chance[k] < probability)) continue;
      // A comparison with NaN is false, so what is not there changes nothing.
      float low = here[x], high = here[x];
      for (const float z :
           {above[x], below[x], here[std::max(x - 1, 0)], here[std::min(x + 1, w - 1)]}) {
        if (z < low) low = z;
        if (z > high) high = z;
      }
      if (low > 0.0F && high - low > DepthModel::kJump * low)
        to(x, y) = low + place[k] * (high - low);
    }
  }
}

/// Step 3.
void add_axial_noise(const PixelNoise& noise, core::Image<float>& depth_m) {
  const std::vector<float> n = normals(noise, kAlongRay, depth_m.size());
  float* z = depth_m.data();
  for (std::size_t k = 0; k < n.size(); ++k) z[k] += kinect_axial_sigma_m(z[k]) * n[k];
}

void quantise_disparity(const PixelNoise& noise, core::Image<float>& depth_m) {
  const std::vector<float> n = normals(noise, kAlongRay, depth_m.size());
  float* z = depth_m.data();
  for (std::size_t k = 0; k < n.size(); ++k) {
    const float disparity = kDisparity_m / z[k] + kDisparityNoise * n[k];
    // Not measured if nothing is there (NaN), or if it is too far. Rounding half away from 0.
    const float steps = std::floor(disparity * kDisparitySteps + 0.5F);
    z[k] = z[k] < kRedwoodRange_m && steps > 0.0F ? kDisparity_m * kDisparitySteps / steps
                                                  : kNone;
  }
}

/// The one-sided difference of smaller size; the other one if that is not there; else 0.
inline float gentler(float forward, float backward) {
  const bool use_forward = std::abs(forward) <= std::abs(backward) || std::isnan(backward);
  const float chosen = use_forward ? forward : backward;
  return std::isnan(chosen) ? 0.0F : chosen;
}

/// Step 4. The inverse depth w of a plane is affine in the image: with r = (rx, ry, 1) the ray
/// of a pixel, its normal is n = (dw/drx, dw/dry, w - rx dw/drx - ry dw/dry) up to its length,
/// and n . r = w. Differences are taken to the smoother side, so that edges do not count.
void drop_grazing(const DepthModel& model, const core::CameraIntrinsics& camera,
                  const core::Image<float>& seen, core::Image<float>& to) {
  const auto cosine = static_cast<float>(std::cos(model.grazing_limit_rad));
  const int w = seen.width_px(), h = seen.height_px();
  const auto fx = static_cast<float>(camera.fx_px), fy = static_cast<float>(camera.fy_px);
  for (int y = 0; y < h; ++y) {
    const float* above = seen.row(std::max(y - 1, 0));
    const float* here = seen.row(y);
    const float* below = seen.row(std::min(y + 1, h - 1));
    const float ry = (static_cast<float>(y) + 0.5F - static_cast<float>(camera.cy_px)) / fy;
    for (int x = 0; x < w; ++x) {
      const float inverse = 1.0F / here[x];
      const float left = x > 0 ? inverse - 1.0F / here[x - 1] : kNone;
      const float right = x + 1 < w ? 1.0F / here[x + 1] - inverse : kNone;
      const float up = y > 0 ? inverse - 1.0F / above[x] : kNone;
      const float down = y + 1 < h ? 1.0F / below[x] - inverse : kNone;
      const float rx = (static_cast<float>(x) + 0.5F - static_cast<float>(camera.cx_px)) / fx;
      const float nx = fx * gentler(right, left), ny = fy * gentler(down, up);
      const float nz = inverse - rx * nx - ry * ny;
      const float n2 = nx * nx + ny * ny + nz * nz, r2 = rx * rx + ry * ry + 1.0F;
      if (inverse * inverse < cosine * cosine * n2 * r2) to(x, y) = kNone;
    }
  }
}

/// Step 5.
void cut_range(const DepthModel& model, core::Image<float>& depth_m) {
  const auto low = static_cast<float>(model.min_range_m);
  const auto high = static_cast<float>(model.max_range_m);
  for (float& z : depth_m.pixels()) z = z > 0.0F && z >= low && z <= high ? z : kNone;
}

}  // namespace

const char* to_string(DepthNoise noise) {
  constexpr const char* kNames[] = {"ideal", "kinect-axial", "redwood"};
  return kNames[static_cast<std::size_t>(noise)];
}

void measure_depth(const DepthModel& model, const core::CameraIntrinsics& camera,
                   const PixelNoise& noise, const core::Image<float>& true_depth_m,
                   core::Image<float>& measured_m) {
  SEGSIM_CHECK(&true_depth_m != &measured_m, "two images");
  measured_m.resize(true_depth_m.width_px(), true_depth_m.height_px());
  if (model.noise == DepthNoise::kRedwood) {
    jitter(noise, true_depth_m, measured_m);
  } else {
    std::copy(true_depth_m.pixels().begin(), true_depth_m.pixels().end(),
              measured_m.pixels().begin());
  }
  if (model.flying_pixels > 0.0) let_edges_fly(model, noise, true_depth_m, measured_m);
  if (model.noise == DepthNoise::kKinectAxial) add_axial_noise(noise, measured_m);
  if (model.noise == DepthNoise::kRedwood) quantise_disparity(noise, measured_m);
  if (model.grazing_limit_rad > 0.0) drop_grazing(model, camera, true_depth_m, measured_m);
  cut_range(model, measured_m);
}

}  // namespace segsim::sim
